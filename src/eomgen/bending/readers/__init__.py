"""Readers of matrices and nodes as programs of finite elements write them: a module a program."""
