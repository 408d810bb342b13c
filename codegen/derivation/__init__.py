"""Joint blocks derived by SymPy anew, the terms of M and C that survive, both compared with programs, and a report.

What a build takes from the kept table is derived from eq. (3) for the joints of one robot; a difference is an error.
Uses robot, program, joint, tree, kernels, closed_form and c.
"""
