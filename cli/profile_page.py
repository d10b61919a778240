"""docs/profiles.md: how to add a robot of one's own, and every key of a profile, from `robots.profile_keys`.

The profile of the walk-through is the one that the tests check, part by part.
"""

from __future__ import annotations

from collections.abc import Iterator

WALK_THROUGH = """\
# Robot profiles

A robot is a TOML file: where its URDF or MJCF is, and which link follows which segment of the person. Nothing needs to be installed;
every command takes `--robot ./mine.toml`. All [packaged robots](robots.md) are such files.

- [Your own robot, step by step](#your-own-robot-step-by-step)
- [When a check fails](#when-a-check-fails)
- [Frames, units, names](#frames-units-names)
- [Every key](#every-key)

## Your own robot, step by step

```bash
retarget robots new my_robot.urdf -o mine.toml      # or .xml, MJCF: guesses links, T-pose, base and fingers, and checks them
retarget robots check ./mine.toml
retarget convert walk.mvnx --robot ./mine.toml
```

`robots new` needs names that tell left from right. Every guess is marked in the file; feet and hands are left to you. What follows is the same by hand, with what to do about checks that
fail. The example is Aldebaran's Romeo, whose URDF comes with `example-robot-data`, which `retarget` has installed anyway.

**1. The smallest profile** says where the model is and maps links. Save as `romeo.toml`:

```toml
[model]
package = "example-robot-data"
path = "romeo_description/urdf/romeo_small.urdf"

[links]
Pelvis = "body"
T8 = "torso"
Head = "HeadRollLink"
LeftUpperArm = "LElbowRollLink"
LeftForeArm = "LElbowYawLink"
LeftHand = "l_wrist"
RightUpperArm = "RElbowRollLink"
RightForeArm = "RElbowYawLink"
RightHand = "r_wrist"
LeftUpperLeg = "LHipPitchLink"
LeftLowerLeg = "LKneePitchLink"
LeftFoot = "l_ankle"
RightUpperLeg = "RHipPitchLink"
RightLowerLeg = "RKneePitchLink"
RightFoot = "r_ankle"
```

A model of your own stands beside the profile: `file = "romeo_small.urdf"` in place of `package` and `path`, or `file = "scene.xml"` for MJCF.
Meshes are only needed for contacts; `package://NAME/…` is looked for in the folders around the URDF.

Which link? The one that turns as the segment does. A limb begins behind **all** joints that swing or twist its bone: Romeo's upper arm is not the
shoulder's link but the one behind `LElbowRoll`, which twists the upper arm in spite of its name. The forearm comes right behind the elbow's hinge, the hand behind the last
wrist joint, the shank behind the knee, the foot behind the last ankle joint. T8 is the link that carries the arms. A robot without a head, or without legs, leaves
these out.

**2. Check it.** `retarget robots check ./romeo.toml` puts the robot into the T-pose that its own solver finds, facing +X, and measures there. It prints what failed; with `-v`
everything:

```text
romeo: 33 checks, 8 failed
  FAILED   T-pose T8 orientation: 18.83 deg (limit 5) LShoulderPitch at its limit; …
  FAILED   T-pose LeftUpperArm direction: 12.16 deg (limit 1) LShoulderPitch at its limit; if it has to be so, under [tpose_exceptions]: …
```

A line is: the check, the value, its limit, the reason. The robot converts already, but the check has found that it doesn't get its arms out to the sides, and what stops it.

**3. Say what T-pose looks like.** Joints start at 0 unless told otherwise, and Romeo's arms then point forward. The rotations of chest, head, hands and feet are read off in
the reference posture, so get it as near to a T-pose as the joints allow:

```toml
[reference_posture_rad]
LShoulderYaw = 1.14
RShoulderYaw = -1.14
```

**4. See what is left.** The shoulders stop at 65°, so the solver turned and leaned the trunk to bring the arms out. A person's trunk is upright there; heavier
weights keep Romeo's so:

```toml
[mapping.limb_plane.weights]
Pelvis = 10.0
T8 = 10.0
```

Now four checks fail, by the same angle left and right, and each one ends with the line that would state it:

```text
romeo: 33 checks, 4 failed
  FAILED   T-pose LeftUpperArm direction: 25.44 deg (limit 1) LShoulderPitch at its limit; if it has to be so, under [tpose_exceptions]: LeftUpperArm = { joint = "LShoulderPitch", error_deg = 25.44 }
```

**5. State what the robot can't do**, when you believe it. A wrong link or limit would look different: see [below](#when-a-check-fails).

```toml
[tpose_exceptions]
LeftUpperArm = { joint = "LShoulderPitch", error_deg = 25.44 }
LeftForeArm = { joint = "LElbowYaw", error_deg = 25.44 }
RightUpperArm = { joint = "RShoulderPitch", error_deg = 25.44 }
RightForeArm = { joint = "RElbowYaw", error_deg = 25.44 }
```

**6. Give it feet**, and the stance foot stays on the floor. The corners are in the foot link's frame; URDFs often have a link for the sole, as Romeo has `l_sole`:

```toml
[feet.Left]
link = "l_ankle"
sole_m = [[0.13, 0.034, -0.068], [0.13, -0.034, -0.068], [-0.04, -0.034, -0.068], [-0.04, 0.034, -0.068]]

[feet.Right]
link = "r_ankle"
sole_m = [[0.13, 0.034, -0.068], [0.13, -0.034, -0.068], [-0.04, -0.034, -0.068], [-0.04, 0.034, -0.068]]
```

**7. Use it.** `retarget robots check ./romeo.toml` now says that nothing failed.

```bash
retarget convert walk.mvnx --robot ./romeo.toml --report walk.html             # walk_romeo.mcap, and a page to look at
retarget validate walk_romeo.mcap --robot ./romeo.toml
retarget convert walk.mvnx --robot ./romeo.toml --smooth 0.1 --force            # where a motor was too weak
```

On this package's own walk (`python -c "from retarget import samples; print(samples.sample_path('walk'))"` says where it is) the limbs are 1.1° off in the mean. Romeo's hips would need 53 of
their 46.6 Nm, and `validate` says so; smoothed, 0.7 of their torque is enough and it passes.

## When a check fails

| what you see | what to do |
|---|---|
| the model has no link '…' | the message names the nearest; `[links]` wants links, not joints |
| no joint lies between links '…' and '…' | two segments of a limb have the same link, or the order is not outward |
| the robot faces away, or `left of the right one` fails | `base_rpy_rad` in `[model]`: how the root link stands in the world when the robot faces +X; or left and right links are exchanged |
| a T-pose error of an arm or leg, no joint at its limit | the link doesn't turn with that bone: a joint that twists the upper arm still lies behind it, or the forearm's link comes behind a wrist joint |
| a hinge `keeps its bones … out of line` | by a few degrees: the robot is built so, state it. By more: the chest's or the hand's link is wrong, and with it the shoulder's or the wrist's centre |
| a T-pose error of chest, head or foot | `[reference_posture_rad]` is not a T-pose: their rotations are read off there |
| a T-pose error of a hand only | `[hands.Left]`, `[hands.Right]`: where fingers and palm point |
| a T-pose error with a joint at its limit | is the limit real? `[limits.joints]` corrects it, `[tpose_exceptions]` states what can't be changed |
| chest or pelvis lean for the arms' sake | `[mapping.limb_plane.weights]`, as above |
| an arm spins about itself in a conversion | `posture_weight` in `[solver]`, 0.003 to 0.01 |
| largest joint speed | a placeholder in the URDF: `default_velocity_rad_s` in `[limits]`, or single joints below `[limits.joints]`. MJCF always needs it |
| sole out of level, soles at different heights | corners in another link's frame, or feet that are not flat in T-pose |
| pairs of links touching | collision shapes that overlap; those pairs are left out of `validate` |
| shapes left out | meshes that were not found; inertias and kinematics don't need them |
| torque saturation in `validate` | `[torque.limit_nm]` where the URDF's efforts are placeholders; else the motion is too quick: `convert --smooth 0.1` |
| fingers move, or a gripper counts as joints | `locked_joints` in `[model]`, patterns allowed: `["*Finger*", "*Thumb*"]` |

`retarget robots show ./romeo.toml` lists links, joints and limits as they are used. A variant of a packaged robot is shorter: `extends = "g1"`, and what differs.

## Frames, units, names

World: X forward, Y left, Z up. Vectors and points are in the frame of the link that stands beside them, as the URDF has it (MJCF: the body's frame). Lengths are m, angles rad, speeds
rad/s, torques Nm, unless the key's name says otherwise. Rotations typed as roll, pitch, yaw turn about the world's fixed X, then Y, then Z. Joints and links are the model's own names; MJCF's bodies are
links. Keys are checked: an unknown one is an error that names the nearest.

SEGMENT is one of {segments}; SIDE is `Left` or `Right`.

## Every key
"""


def profiles_page() -> str:
    """The walk-through, then every table with its keys, as Markdown."""
    from retarget.cli.docs import NOTE
    from retarget.core.segments import SEGMENTS

    text = WALK_THROUGH.replace("{segments}", ", ".join(f"`{segment}`" for segment in SEGMENTS))
    return "\n".join([NOTE, text, *_tables()])


def _tables() -> Iterator[str]:
    from retarget.robots.profile_keys import TABLES

    for table in TABLES:
        yield f"### `{table.place}`\n" if table.place else "### Top level\n"
        if table.meaning:
            yield f"{table.meaning}\n"
        yield "| key | value | without it | |\n|---|---|---|---|"
        keys = {table.any_of: next(iter(table.keys.values()))} if table.any_of else table.keys
        for name, key in keys.items():
            shown = name if table.any_of else f"`{name}`"
            yield f"| {shown} | {key.value} | {key.default} | {key.meaning} |"
        yield ""
