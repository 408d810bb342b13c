"""Many simulations of a robot whose numbers vary: plans, samples, workers, stores, results.

Uses runtime, robot, forms, state, integration, scenario, pipeline and simulation.
"""
