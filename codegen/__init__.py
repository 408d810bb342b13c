"""The generator: SymPy joint blocks, programs, C, and an importable package.

Its packages, each uses those before it: program, joint, tree, forces, solve, kernels, closed_form, c, simt,
package.  Uses robot, templates, and of runtime the files that a package carries.
"""
