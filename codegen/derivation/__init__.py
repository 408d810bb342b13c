"""Report of a derivation: blocks of joints, terms of M and C.

Uses robot, joint, closed_form and c.
"""
