"""Manufacturing files of mechanisms: outlines as DXF and SVG, bodies as STL, an assembly drawing as PDF or PNG.

The packages that write these files are imported when a file is written: pip install "rollingjoint[cad]".

Modules:
    assembly: the bodies of a mechanism in their poses.
    body: bodies of the links: outlines and drilled channels.
    channel: the channel of a tendon through a link, checked for drilling.
    command: the options of `rj export`, and its files.
    drawing: the assembly drawing.
    fabrication: thickness, channels and tolerance of bodies.
    files: the files of an export, written all or none.
    flat: DXF and SVG.
    packages: imports of packages that only an export needs.
    sampling: surfaces as polylines within a tolerance.
    sheet: a sheet of paper in mm.
    solid: bodies as STL.
    tables: the tables of the assembly drawing.
"""

from rollingjoint.cad.body import Body, bodies
from rollingjoint.cad.channel import Channel
from rollingjoint.cad.drawing import assembly_drawing
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.files import FORMATS, export

__all__ = ["FORMATS", "Body", "Channel", "Fabrication", "assembly_drawing", "bodies", "export"]
