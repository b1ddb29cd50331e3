"""Mechanisms for the workshop: outlines as DXF and SVG, bodies as STL, an assembly drawing as PDF or PNG.

The packages that write these files are imported when a file is written: pip install "rollingjoint[cad]".
"""

from rollingjoint.cad.body import Body, bodies
from rollingjoint.cad.channel import Channel
from rollingjoint.cad.drawing import assembly_drawing
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.files import FORMATS, export

__all__ = ["FORMATS", "Body", "Channel", "Fabrication", "assembly_drawing", "bodies", "export"]
