"""Methods of kernels that call one function of C each, and how they call it.

``kernel_methods`` is written from the table of kernels; ``bound`` has the functions that its methods call.
"""
