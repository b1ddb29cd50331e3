"""The rooms of the browser viewer, and what they show."""
