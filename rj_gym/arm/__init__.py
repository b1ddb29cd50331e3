"""The task "bring the tip of a hanging arm to a target under an unknown payload and gravity direction"."""
