"""BLAKE2b for the draws of boards, fleet and water.

CPython's own module serves: `hashlib` would load OpenSSL into every agent's process, which takes 5 ms and its memory.
"""

from _blake2 import blake2b

__all__ = ["blake2b"]
