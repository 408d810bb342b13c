"""Results of measurements drawn and as pages: a module for each family, ``kinds`` knows which page a result has.

Uses identification, and of pictures what all figures and pages have in common.
"""
