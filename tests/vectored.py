"""What a vector says, beside what as many single environments say."""

import numpy as np

WORDS = ("shield/reason", "shield/kind")
"""What vectors say in codes."""


def same_infos(one, other, what):
    assert set(one) == set(other), what
    for key, value in one.items():
        if isinstance(value, dict):
            same_infos(value, other[key], f"{what}: {key}")
        elif value.dtype == object:
            for a, b in zip(value, other[key], strict=True):
                np.testing.assert_array_equal(a, b, err_msg=f"{what}: {key}")
        else:
            assert value.dtype == other[key].dtype, f"{what}: {key}"
            np.testing.assert_array_equal(value, other[key], err_msg=f"{what}: {key}")


def without_words(infos):
    """Infos without the words, and the words."""
    words = {key: infos[key] for key in WORDS if key in infos}
    rest = {key: value for key, value in infos.items() if key.removeprefix("_") not in WORDS}
    return rest, words
