"""The generator: SymPy joint blocks bound along the tree, programs, C, and a package that imports.

Its packages, each uses those before it: program, joint, tree, forces, solve, kernels, closed_form, c, simt,
package.  Uses robot, templates, and of runtime the files that a package carries.
"""
