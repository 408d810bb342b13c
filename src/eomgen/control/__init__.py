"""Control of robots: feed-forward, observers and prediction, in Python and as C.

Uses runtime.
"""
