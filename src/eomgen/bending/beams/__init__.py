"""What is made of a beam beside its modes: a chain of segments, stress resultants, and stations to draw it by."""
