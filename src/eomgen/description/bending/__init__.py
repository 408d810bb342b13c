"""Reading of what bends: beams as chains of segments, links by their modes, and nodes of these."""
