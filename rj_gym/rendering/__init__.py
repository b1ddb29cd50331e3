"""What all drawings of environments share."""
