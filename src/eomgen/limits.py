"""Limits of what descriptions, scenarios, plans and results may hold, whatever format they come in."""

LARGEST = 1e30  # numbers beyond it would overflow in products
LARGEST_FOUND = 1e150  # of what was computed: sums of squares stay finite
LARGEST_FINITE = 1.7e308  # of what is only shown
MOST_ENTRIES = 5_000  # links, joints, ...: far beyond what can be derived, and read in a second
