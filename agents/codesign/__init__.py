"""Co-design: surfaces, holes and a policy for them, by one gradient or by search, and the proof whether it pays."""
