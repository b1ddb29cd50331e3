"""The tracking task: bring the tip to a target under loads."""
