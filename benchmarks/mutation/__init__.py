"""Mutation testing of the derivation: ``python -m benchmarks.mutation`` writes docs/mutation.md."""
