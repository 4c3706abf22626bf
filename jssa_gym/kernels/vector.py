"""Three-vectors as plain scalars: no allocation, no BLAS call."""

from jssa_gym.kernels.jit import jit


@jit
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a, b):
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jit
def add(a, b):
    """Sum a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@jit
def subtract(a, b):
    """Difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@jit
def scale(a, k):
    """Multiple k a."""
    return (a[0] * k, a[1] * k, a[2] * k)


@jit
def along(a, b, k):
    """A + k (b - a): the point at fraction k of the way from a to b."""
    return (a[0] + k * (b[0] - a[0]), a[1] + k * (b[1] - a[1]), a[2] + k * (b[2] - a[2]))


@jit
def put(target, a):
    """Write a vector into an array."""
    target[0] = a[0]
    target[1] = a[1]
    target[2] = a[2]


@jit
def copy(source, target):
    """One row of numbers into another, shape (n,); the same as a slice assignment, which compiles to much more."""
    for k in range(target.shape[0]):
        target[k] = source[k]


@jit
def copy_rows(source, target):
    """The same of several rows."""
    for i in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[i, k] = source[i, k]


@jit
def same_rows(one, other):
    """Whether several rows of numbers are equal; NaN is not."""
    same = True
    for i in range(one.shape[0]):
        for k in range(one.shape[1]):
            same = same and one[i, k] == other[i, k]
    return same


@jit
def fill(target, value):
    """One number into a row of numbers, shape (n,)."""
    for k in range(target.shape[0]):
        target[k] = value


@jit
def fill_rows(target, value):
    """The same of several rows."""
    for i in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[i, k] = value
