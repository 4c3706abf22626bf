"""What is believed of people: the last measurements that can be trusted, and how old they are."""

import numpy as np

from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.occupancy import UNCONFIRMED
from jssa_gym.kernels.people import COVERED, judge_people
from jssa_gym.tick import codes
from jssa_gym.tick.joints import timely
from jssa_gym.tick.region import meet_newcomers, take_frame, watches

NO_TIME, BACK = 1, 2
"""What is wrong with the time by which people move: it is none, or went back."""


@jit
def forget_people(memory, e):
    """Whoever is measured next is who there is."""
    arm = memory.arm[e]
    arm["met"], arm["people_time"] = False, -np.inf
    arm["seen"], arm["ahead"], arm["missed"], arm["frame"] = np.nan, 0.0, 0, -np.inf
    for k in range(memory.tracks.shape[1]):
        track = memory.tracks[e, k]
        for row in range(4):
            for i in range(3):
                track["trusted"][row, i] = track["seen"][row, i] = track["anchor"][row, i] = np.nan
        track["radius"], track["stamp"], track["first"] = np.nan, -np.inf, -np.inf
        track["anchor_radius"], track["anchor_stamp"] = np.nan, -np.inf
        track["steady"] = UNCONFIRMED


@part
def people_clock(settings, memory, now, readable, e):
    """The scene's time, set forward where it does not keep up with the ticks: people move on though a clock stands.

    What is no time, or went back, is given back as it is.
    """
    arm = memory.arm[e]
    arm["missed"] += 1
    # a reading that is none, or went back, does not count: the ticks since the last that does are still due
    if not readable or now < arm["seen"] or not np.isfinite(now):
        return now
    ahead = _ahead(settings, arm, now, arm["missed"])
    arm["seen"], arm["missed"] = now, 0
    if settings.paced:  # ticks go by this clock, not the other way round
        return now
    arm["ahead"] = ahead
    return now + ahead


@jit
def _ahead(settings, arm, now, missed):
    """How far people are ahead of the scene's time, so many ticks after the last [s]."""
    gap, due = now - arm["seen"], settings.dt * missed
    # what it falls behind counts until it has caught up; a rounding is nothing
    if abs(due - gap) > 1e-6 * due:
        return max(arm["ahead"] + due - gap, 0.0)
    return arm["ahead"]


@jit
def coming_clock(arms, now):
    """The time that the next :func:`people_clock` of a single arm will give; NaN where people will not be looked at."""
    settings, arm = arms.settings, arms.memory.arm[0]
    if now < arm["seen"] or not np.isfinite(now):
        return np.nan
    time = now if settings.paced else now + _ahead(settings, arm, now, arm["missed"] + 1)
    return time if time >= arm["people_time"] else np.nan


@part
def check_people(settings, memory, scene, work, answer, e):
    """Take in the people and say whether what is trusted covers everybody; a code, or 0.

    Into ``work``: the trusted sample of each capsule and its age. Has to be asked once a tick, after
    :func:`~jssa_gym.tick.joints.check_joints`.
    """
    arm = memory.arm[e]
    if not scene.now[e]["seen"]:
        arm["missed"] += 1
        return codes.PEOPLE
    time = people_clock(settings, memory, scene.now[e]["time"], scene.now[e]["timed"], e)
    if not timely(memory, e):
        # joints that rest look the same at all times, but people go on: those of another tick are not those of now
        return codes.OTHER_TICK
    return _update(settings, memory, scene, time, work, answer, e)


@jit
def _update(settings, memory, scene, time, work, answer, e):
    arm, told = memory.arm[e], answer.told[e]
    if not scene.now[e]["timed"]:
        return codes.PEOPLE
    told["detail"], told["moment"] = 0, time
    if not np.isfinite(time):
        told["detail"] = NO_TIME
        return codes.PEOPLE
    if not time >= arm["people_time"]:
        told["detail"] = BACK
        return codes.PEOPLE
    if not scene.now[e]["people"]:
        return codes.PEOPLE
    if not arm["met"]:
        for k in range(memory.tracks.shape[1]):
            memory.tracks[e, k]["person"] = scene.person[e, k]
        arm["met"] = True
    arm["people_time"] = time
    if watches(settings):
        meet_newcomers(settings, memory, scene, time, e)
    worst, verdict, cover, fresh = judge_people(
        time,
        scene.ends[e],
        scene.radius[e],
        scene.age[e],
        scene.valid[e],
        scene.person[e],
        settings.position_error,
        settings.max_age,
        memory.tracks[e],
        work.people,
        work.radius,
        work.age,
    )
    told["fresh"], told["sample"] = fresh, verdict
    unseen = watches(settings) and not take_frame(settings, memory, scene, time, e)
    if worst >= 0:
        told["other"], told["detail"], told["moment"] = worst, cover, work.age[worst]
        if cover != COVERED:
            return codes.TRUST + 1 + verdict
    if unseen:
        told["moment"] = time - arm["frame"]
        return codes.UNWATCHED
    return 0


@jit
def people_now(memory, work, answer, e):
    """People moved on at their measured velocities from when they were measured, into ``work.agents``."""
    people, fresh = work.people, answer.told[e]["fresh"]
    for k in range(memory.tracks.shape[1]):
        agent, late = work.agents[k], work.age[k]
        for i in range(3):
            agent["start_velocity"][i], agent["end_velocity"][i] = people[2, k, i], people[3, k, i]
            start, end = people[0, k, i], people[1, k, i]
            if not fresh:
                start, end = start + late * people[2, k, i], end + late * people[3, k, i]
            agent["start"][i], agent["end"][i] = start, end
        agent["radius"] = work.radius[k]
