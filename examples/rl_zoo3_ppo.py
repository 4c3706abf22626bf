"""Hyper-parameters in the format of rl_zoo3, which reads ``hyperparams`` (a starting point, not tuned).

    python -m rl_zoo3.train --algo ppo --env jssa_gym/ReachShielded-v0 --gym-packages jssa_gym \
        --conf-file examples/rl_zoo3_ppo.py
"""

hyperparams = {
    "jssa_gym/ReachShielded-v0": {
        "env_wrapper": [{"jssa_gym.ActionRepeat": {"ticks": 5}}],  # the policy at 25 Hz, the shield at 125 Hz
        "policy": "MlpPolicy",
        "n_envs": 4,
        "n_timesteps": 200_000,
        "n_steps": 256,
        "batch_size": 128,
        "n_epochs": 10,
        "learning_rate": 3e-4,
        "gamma": 0.98,
        "gae_lambda": 0.95,
        "clip_range": 0.2,
    },
}
