"""Who does a command's work: this machine's processes, or a Ray cluster."""

from dataclasses import dataclass
from typing import Literal

from jssa_gym.engine.cluster import Cluster, whose
from jssa_gym.exceptions import ParameterError


@dataclass(frozen=True)
class Engine:
    """Results do not depend on it."""

    jobs: int = 1
    """How many processes; of `certify` without a cluster, threads."""
    engine: Literal["local", "ray"] = "local"
    """Who runs them: this command itself, or Ray, which plays again what a worker had that died."""
    address: str | None = None
    """Address of a Ray cluster that runs already, all of whose processors count; without one --jobs are started
    here."""

    def chosen(self) -> int | Cluster:
        """As evaluations and certificates take it.

        Raises:
            ParameterError: A value is out of range, or an address is there that nobody asks.
        """
        if self.engine == "ray":
            return Cluster(self.jobs, self.address)
        if self.address is not None:
            raise ParameterError("--address is of a Ray cluster: give --engine ray as well")
        return whose(self.jobs)
