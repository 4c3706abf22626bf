"""Work shared out: to this process, to some of this machine, or to a Ray cluster.

``workers`` hands out chunks and collects what comes of them, ``cluster`` does so on Ray, ``interrupts`` end it before
its time, and ``source`` tells which code it is, that all of them have to have.
"""

from jssa_gym.engine.cluster import Cluster

__all__ = ["Cluster"]
