"""Beams beside their modes: chains of segments, stress resultants, and stations to draw them by."""
