"""Why a problem has no certified motion: a code for sorting, and a sentence for a person."""

from __future__ import annotations

from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.scenes.errors import HdplanError, InputError, TimeLimitError, UnsolvableError

CAUSES = {
    "end_in_contact": "start or goal is in contact",
    "end_too_close": "start or goal has less clearance than required",
    "end_beyond_limits": "start or goal is beyond a joint limit",
    "end_off_path": "start or goal is off a path constraint",
    "end_overloaded": "start or goal overloads a joint",
    "end_too_fast": "start or goal is too fast to brake within the limits",
    "disconnected": "no motion exists: start and goal are shut off from one another",
    "goal_not_reached": "no inverse kinematics reaches the goal",
    "too_hurried": "the duration allows no such motion",
    "time": "the time limit passed",
    "bad_input": "a file or a value is invalid",
    "local_minimum": "no free motion was found from the guesses tried",
    "clearance": "a motion was found, with less clearance than required",
    "grazing": "a motion grazes a body: neither proven nor refuted",
    "joint_limit": "the range left to a joint allows no free motion",
    "path_constraint": "a path constraint is not kept",
    "rates": "a limit of velocity, acceleration or jerk is not kept",
    "torque": "a limit of torque is not kept",
    "stage_failed": "a stage of a job has no certified motion",
    "ended": "its process ended twice: a crash, or too much memory",
    "hung": "it did not return long after its time limit",
    "internal": "an internal error",
}
"""Every code, and what it means."""

_OF_STATUS = {
    Status.WRONG_ENDS: "internal",
    Status.OUTSIDE_LIMITS: "internal",
    Status.IN_CONTACT: "local_minimum",
    Status.TOO_CLOSE: "clearance",
    Status.OFF_PATH: "path_constraint",
    Status.TOO_FAST: "rates",
    Status.OVERLOADED: "torque",
    Status.NOT_PROVEN: "grazing",
}


def cause_of_refusal(error: HdplanError) -> str:
    """Return the code of a refused problem."""
    match error:
        case TimeLimitError():
            return "time"
        case UnsolvableError(cause=cause):
            return str(cause)
        case InputError():
            return "bad_input"
    return "rates"  # no time law within the limits


def cause_of_verdict(certificate: Certificate, hurried: bool) -> str:
    """Return the code of a motion that is not certified; of a `hurried` certificate the time limit ended the check,
    which counts where it found nothing wrong."""
    return "time" if hurried and certificate.status is Status.NOT_PROVEN else _OF_STATUS[certificate.status]
