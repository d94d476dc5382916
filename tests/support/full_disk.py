"""A disk that is full, for files of this process and its children."""

import resource
from contextlib import contextmanager


@contextmanager
def largest_file(size):
    """No file can grow beyond `size` [bytes] meanwhile ("File too large"). Yields a function that changes the size."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield lambda other: resource.setrlimit(resource.RLIMIT_FSIZE, (other, hard))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
