"""A term of one's own in the cost, with exact derivatives: keep the elbow near a posture."""

import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan.planner.problem.terms import MotionPenalty, Term


class Posture(Term):
    """h Σ_k ½ (s (q_kj − r))²: joint j near r, s what a radian counts as, in metres inside a margin [m/rad]."""

    name = "posture"

    def __init__(self, joint: int, preferred: float, scale: float) -> None:
        """Take the joint's index, r [rad] and s."""
        self.joint, self.preferred, self.scale = joint, preferred, scale

    def over_motion(self, positions, kinematics):
        """Cost, gradient (N, n) and curvature (N, n, n) at waypoints (N, n)."""
        count, n = positions.shape
        off = self.scale * (positions[:, self.joint] - self.preferred)
        gradient, diagonal = np.zeros((count, n)), np.zeros((count, n, n))
        gradient[:, self.joint] = self.scale * off / count
        diagonal[:, self.joint, self.joint] = self.scale**2 / count
        coupling, depth = np.zeros((count - 1, n, n)), np.zeros(count - 1)  # it asks for nothing between waypoints
        return MotionPenalty(0.5 * float(off @ off) / count, gradient, diagonal, coupling, depth)

    def bend(self, kinematics, samples):
        """What the exact Hessian has beyond the curvature, for the CasADi program: nothing."""


scene = hdplan.load_scene("panda_corridor")
plain = hdplan.build(scene)
elbow = plain.robot.joint_names.index("panda_joint4")
own = plain.with_term(Posture(elbow, -2.2, scale=0.1))

figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for problem, name in ((plain, "as it is"), (own, "with the term")):
    trajectory = hdplan.solve(problem).trajectory
    certificate = hdplan.certify(scene, trajectory)  # a new term changes what is sought, not what is proven
    print(f"{name}: {certificate.text}")
    axes.plot(trajectory.positions[:, elbow], label=f"{name}: {certificate.status.value}")
axes.axhline(-2.2, color="grey", linestyle=":")
axes.set(xlabel="waypoint", ylabel="panda_joint4 [rad]", title="the term draws joint 4 towards −2.2 rad")
axes.legend()
figure.savefig("own_term.png", dpi=100)
