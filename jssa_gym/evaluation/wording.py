"""What metrics are called on pages, in words."""

WORDS = {
    "success_and_safe_rate": "success, and safe",
    "success_untouched_rate": "success, nobody touched",
    "success_rate": "success",
    "collision_rate": "any contact",
    "moving_contact_rate": "contact with the arm moving",
    "limits_exceeded_rate": "joint limit exceeded",
    "min_distance": "smallest distance",
    "min_distance_arm": "smallest distance of the arm",
    "contact_speed": "fastest contact",
    "ep_return": "return",
    "ep_len": "length",
    "ep_cost": "cost",
    "emcc": "longest stay below d_min",
    "intervention_rate": "steps changed",
    "backup_rate": "steps of a stored stop",
    "fault_rate": "steps with a fault",
    "relaxed_rate": "steps with least violation",
    "infeasible_rate": "steps with a row missed",
    "trigger_rate": "steps with more than clipping",
    "jerk_jumps": "steps with a jump of the jerk",
    "jerk_jumps_shield": "jumps of the jerk by the filter",
    "jerk_jumps_nominal": "jumps of the jerk by the policy",
    "status_switches": "switches of status",
    "jerk_rms": "RMS jerk",
    "path_length": "way of the tool",
    "time_to_goal": "time to the goal",
    "ttc": "time to collision",
    "n_collision_events": "contacts",
    "n_collisions_critical": "critical contacts",
    "n_collisions_noncritical": "other contacts",
    "n_collisions_robot_fault": "contacts by the robot's fault",
    "n_collisions_human_fault": "contacts by the person's fault",
    "n_collisions_shared_fault": "contacts by both's fault",
    "n_collisions_self": "contacts of the arm with itself",
    "n_collisions_static": "contacts with table or floor",
    "n_actions_not_finite": "actions that were not finite",
    "n_activations": "activations",
    "shield_p50": "decision time, median",
    "shield_p95": "decision time, 95 %",
    "shield_p99": "decision time, 99 %",
    "shield_max": "decision time, longest",
    "ssm_margin": "margin of speed and separation",
    "phi_max": "largest index told",
    "true_phi_max": "largest index measured",
}
"""By name over episodes; of all others the name itself says enough."""


def in_words(name: str, unit: str = "") -> str:
    """A metric's name over episodes in words, and its unit."""
    words = WORDS.get(name) or name.removesuffix("_rate").replace("_", " ")
    return f"{words} [{unit}]" if unit else words
