"""A robot as a page that moves: one file of HTML with its kernel as WebAssembly, its shapes, its drives.

Uses robot, description, state, loops, integration, motion, scenario, pipeline, simulation, pictures, templates and wasm.
"""
