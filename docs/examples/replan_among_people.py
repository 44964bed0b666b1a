"""A Panda drives to its goal while a person walks through its way: every 40 ms a command that is proven to its end."""

from concurrent.futures import Executor, Future

import numpy as np

import hdplan

scene = hdplan.Scene(
    robot=hdplan.RobotSpec("panda", tracking=hdplan.Tracking(0.002)),
    obstacles=[hdplan.Obstacle("floor", hdplan.Box([2, 2, 0.1]), [0, 0, -0.1])],
    start=[0.9, 0.3, 0, -1.9, 0, 2.2, 0.785],
    goal=[-0.9, 0.3, 0, -1.9, 0, 2.2, 0.785],
    limits=hdplan.Limits(velocity="urdf", acceleration=10, jerk=1000),
)


def seen(t):
    """A person in a camera's picture at a time: the place, to 1 cm, and a speed of at most 0.4 m/s."""
    sizes = hdplan.Uncertainty(0.01, speed=0.4)
    return hdplan.Obstacle("person", hdplan.Capsule(0.1, 0.6), [0.75, -0.5 + 0.4 * t, 0.5], uncertainty=sizes)


class AtOnce(Executor):
    """An executor for a simulated clock, as here; on a robot a thread of the replanner's own searches for ways."""

    def submit(self, work, *args):
        """Run a task at once."""
        future = Future()
        future.set_result(work(*args))
        return future


t, modes = 0.0, []
with hdplan.Replanner(scene, period=0.04, latency=0.01, clock=lambda: t, executor=AtOnce()) as replanner:
    for k in range(500):
        t = 0.04 * k
        replanner.update([seen(t - 0.05)], at=t - 0.05 if k > 1 else 0.0)  # the picture is 50 ms old
        command = replanner.step(t)  # a robot's loop would send it, and wait for the next period
        replanner.state(command.position, command.velocity)  # which it would measure
        modes.append(command.mode.value)
        if modes[-1] == "arrived":
            break

print({mode: modes.count(mode) for mode in dict.fromkeys(modes)})
print("at the goal:", np.allclose(command.position, scene.goal.positions, atol=1e-3))
