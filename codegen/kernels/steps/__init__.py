"""Steps that the error chooses: tables of methods, and sizes that tolerances refer to."""
