"""The design task: change the curvatures of a mechanism until it bends as wanted. It needs torch."""
