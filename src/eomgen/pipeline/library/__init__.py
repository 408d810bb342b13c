"""The C library's objects, that robots' libraries are linked with: made once, examined, kept in the cache."""
