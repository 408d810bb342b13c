"""Derivatives of what a kernel computes: by its arguments and parameters, and in time along motions."""
