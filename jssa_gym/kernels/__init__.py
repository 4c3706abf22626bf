"""Mathematics on bare arrays, compiled by numba; knows nothing of the rest of the package."""
