"""The safe trajectory of an audit as a table."""

import csv
import io
from pathlib import Path

from jssa_gym.evaluation.audit.result import Audit
from jssa_gym.storage import write_whole
from jssa_gym.types import Status


def write_safe_trajectory(path: Path, audit: Audit) -> None:
    """Write the motion that the shield would have made, a row a control step; ``jssa-gym audit`` can read it again.

    Numbers are written so that they are read as they were, to the bit. Stretches follow one another; their gaps are
    gaps of the table.

    Args:
        path: Of the ``.csv`` file; it is replaced.
        audit: Whose.

    Raises:
        StorageError: The file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    joints = range(1, audit.stretches[0].safe.position.shape[1] + 1)
    what = ("position", "velocity", "acceleration")
    writer.writerow(["time", *(f"q{j}.{one}" for one in what for j in joints), "status", "reason", "distance", "late"])
    for stretch in audit.stretches:
        safe = stretch.safe
        first = (float(stretch.time[0] - safe.dt), *safe.initial_state.ravel().tolist(), "", "", "", 0.0)
        writer.writerow(first)
        for k, time in enumerate(stretch.time.tolist()):
            state = [float(x) for name in what for x in getattr(safe, name)[k]]
            told = (Status(int(safe.status[k])).name, str(safe.reason[k]), float(safe.distance[k]))
            writer.writerow((time, *state, *told, float(stretch.lateness[k])))
    write_whole(path, text.getvalue())
