"""What makes a MuJoCo model a serial arm; everything else is refused by name."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco


def serial_faults(model: "mujoco.MjModel") -> list[str]:
    """What keeps a model from being one chain of limited hinges that move independently, culprit by culprit."""
    import mujoco

    joint = mujoco.mjtObj.mjOBJ_JOINT
    if model.njnt == 0:
        return ["the model has no joint; expected a serial arm of hinge joints"]
    faults = []
    for j in range(model.njnt):
        kind = mujoco.mjtJoint(model.jnt_type[j])
        if kind != mujoco.mjtJoint.mjJNT_HINGE:
            name = kind.name[6:].lower()
            faults.append(f"{called(model, joint, j)} is of type {name}; only hinge joints can be modelled")
        elif not model.jnt_limited[j]:
            faults.append(f"{called(model, joint, j)} has no range; every joint needs position limits")
    for j in range(1, model.njnt):
        body, before = model.jnt_bodyid[j], model.jnt_bodyid[j - 1]
        while body not in (before, 0):
            body = model.body_parentid[body]
        if body != before:
            faults.append(
                f"{called(model, joint, j)} does not follow {called(model, joint, j - 1)} in one chain; "
                "only serial arms can be modelled"
            )
    return faults + _couplings(model)


def called(model: "mujoco.MjModel", kind: "mujoco.mjtObj", number: int) -> str:
    """A part of a model by its name, or its number where it has none: ``joint 'elbow'`` or ``joint 2``."""
    import mujoco

    name = mujoco.mj_id2name(model, kind, number)
    what = kind.name.removeprefix("mjOBJ_").lower()
    return f"{what} '{name}'" if name else f"{what} {number}"


def _couplings(model: "mujoco.MjModel") -> list[str]:
    """What ties joints to each other or to the world: then ranges of joints do not say where they can be."""
    import mujoco

    faults = []
    for e in range(model.neq):
        alike = {
            mujoco.mjtEq.mjEQ_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
            mujoco.mjtEq.mjEQ_TENDON: mujoco.mjtObj.mjOBJ_TENDON,
        }
        kind = alike.get(mujoco.mjtEq(model.eq_type[e]), mujoco.mjtObj(model.eq_objtype[e]))
        tied = [called(model, kind, i) for i in (model.eq_obj1id[e], model.eq_obj2id[e]) if i >= 0]
        faults.append(
            f"{called(model, mujoco.mjtObj.mjOBJ_EQUALITY, e)} constrains {' and '.join(tied)}; "
            "only joints that move independently can be modelled"
        )
    wrapped = {
        mujoco.mjtWrap.mjWRAP_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
        mujoco.mjtWrap.mjWRAP_SITE: mujoco.mjtObj.mjOBJ_SITE,
    }
    for t in range(model.ntendon):
        if not model.tendon_limited[t]:
            continue
        path = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        kinds = [wrapped.get(mujoco.mjtWrap(model.wrap_type[w])) for w in path]
        tied = [called(model, kind, model.wrap_objid[w]) for w, kind in zip(path, kinds, strict=True) if kind]
        faults.append(
            f"{called(model, mujoco.mjtObj.mjOBJ_TENDON, t)} has a range, which constrains {' and '.join(tied)}; "
            "only joints that move independently can be modelled"
        )
    return faults
