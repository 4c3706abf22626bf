"""What the tests of trainings share: tiny ones, and comparisons to the bit."""

import hashlib
import json
from dataclasses import replace

import numpy as np

from jssa_gym.train import PPO, SAC, TD3, TQC, PPOLagrangian, SACLagrangian, TrainConfig, checkpoint
from jssa_gym.train.checkpoint import MANIFEST

_REPLAY = {"width": 16, "learning_starts": 40, "buffer_size": 200, "batch_size": 32}

SETTINGS = {
    "ppo": PPO(width=16, rollout=64, batch_size=32, n_epochs=2),
    "sac": SAC(**_REPLAY),
    "td3": TD3(**_REPLAY),
    "tqc": TQC(**_REPLAY),
    "ppo-lagrangian": PPOLagrangian(width=16, rollout=64, batch_size=32, n_epochs=2, cost_limit=1e-4),
    "sac-lagrangian": SACLagrangian(**_REPLAY, cost_limit=1e-4),
}
"""Networks and buffers of a few numbers; the buffer runs over."""


def tiny(algorithm="ppo", **changes) -> TrainConfig:
    """Three legs of which each takes a second."""
    config = TrainConfig(settings=SETTINGS[algorithm], steps=192, interval=64, envs=2, eval_episodes=1)
    return replace(config, **changes)


CHECKPOINTED = tiny("sac")
"""What the fixture ``original`` of tests/train is a training of."""


def weights(path) -> dict[str, np.ndarray]:
    """All arrays of a policy's file."""
    with np.load(path, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files if name.endswith(("mean", "std")) or name[-1].isdigit()}


def newest(folder):
    """The newest checkpoint's folder."""
    return max(path for path in (folder / "checkpoints").iterdir() if path.suffix == "")


def results(folder) -> dict:
    """Everything that a training left and that no clock has a part in."""
    manifest = json.loads((newest(folder) / "manifest.json").read_text())
    history = [
        {k: v for k, v in leg.items() if k not in ("seconds", "processor_seconds")}
        for leg in manifest["data"]["history"]
    ]
    policies = {
        name: {key: array.tobytes() for key, array in weights(folder / name).items()}
        for name in ("best.npz", "last.npz")
    }
    assert all(len(found) >= 8 for found in policies.values())
    return {"steps": manifest["steps"], "files": manifest["files"], "history": history, **policies}


def seal(one, **changes):
    """Write a manifest that fits the files, as somebody does who knows how."""
    body = json.loads((one / MANIFEST).read_text())
    del body["sha256"]
    body["files"] = {name: hashlib.sha256((one / name).read_bytes()).hexdigest() for name in body["files"]}
    body |= changes
    (one / MANIFEST).write_text(json.dumps({**body, "sha256": checkpoint.digest_of(body)}))
