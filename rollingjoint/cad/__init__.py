"""Manufacturing files of mechanisms: outlines as DXF and SVG, bodies as STL and STEP, drawings as PDF or PNG.

Chains in space and arms of beads have solids alone, of every link and of the assembly.

The packages that write these files are imported when a file is written: pip install "rollingjoint[cad]",
for STEP "rollingjoint[step]".

Modules:
    assembly: the bodies of a mechanism in their poses.
    body: bodies of the links: outlines and drilled channels.
    channel: the channel of a tendon through a link, checked for drilling.
    command: the options of `rj export`, and its files.
    drawing: the assembly drawing.
    fabrication: thickness, channels and tolerance of bodies.
    files: the files of an export, written all or none.
    flat: DXF and SVG.
    kits: solids from curves, cylinders and cuts, faceted or exact.
    packages: imports of packages that only an export needs.
    sampling: surfaces as polylines within a tolerance.
    sheet: a sheet of paper in mm.
    solid: bodies of planar links.
    space_body: bodies of the links of chains in space.
    space_files: their files.
    space_solid: their bodies.
    tables: the tables of the assembly drawing.
"""

from rollingjoint.cad.body import Body, bodies
from rollingjoint.cad.channel import Channel
from rollingjoint.cad.drawing import assembly_drawing
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.files import FORMATS, export
from rollingjoint.cad.space_body import SpatialBody, spatial_bodies
from rollingjoint.cad.space_solid import spatial_solid

__all__ = [
    "FORMATS",
    "Body",
    "Channel",
    "Fabrication",
    "SpatialBody",
    "assembly_drawing",
    "bodies",
    "export",
    "spatial_bodies",
    "spatial_solid",
]
