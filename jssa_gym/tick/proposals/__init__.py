"""Filters that are compiled: for each a tuple of its own parameters, and the function that proposes by them.

:data:`jssa_gym.tick.propose.KINDS` says which belong together. All functions in it take the same:

    robot: The arm.
    settings: How it is looked after.
    proposal: The filter's own parameters.
    memory: What is remembered; ``memory.state[e]`` is the present joint state.
    nominal: The policy's jerk, shape (n,) [rad/s³].
    work: Scratch: the box, the nominal in it (``clipped``) and the people (``agents``).
    told: What is known of the jerk, a record of ``ANSWER``.
    e: Which arm.

The jerk, in the box, goes into ``work.wanted``, where the clipped nominal is to begin with. What is returned is a
code of :mod:`jssa_gym.tick.codes`: 0 if that is to stay, else why not; or
:data:`~jssa_gym.tick.proposals.rows.PROJECT`.
"""
