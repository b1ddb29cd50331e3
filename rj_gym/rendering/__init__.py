"""What the drawings of all tasks share.

Modules:
    canvas: colours, lines and text in the units of a mechanism, and the window. pygame is imported when first needed.
    tracking: scenes of the tracking tasks, and the words and bars beside them.
"""
