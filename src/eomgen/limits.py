"""Limits of what descriptions, scenarios and plans may hold, whatever format they come in."""

LARGEST = 1e30  # numbers beyond it would overflow in products
MOST_ENTRIES = 5_000  # links, joints, ...: far beyond what can be derived, and read in a second
