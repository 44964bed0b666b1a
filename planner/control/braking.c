/* How joints brake within their limits: the equations of `braking.py`, equal to the last bit. */

#include "../../distance/compiled/border.h"
#include "../../distance/compiled/vectors.h"

#define REST 1e-12 /* as in `braking.py` */

enum { SPARE = 3, MOST_PERIODS = 1 << 30 };

/* One joint: its greatest acceleration, and the greatest change of it in a period. */
typedef struct {
  double most, step, period;
} limits;

/* e(a) */
static double coming(const limits* of, double acceleration) {
  const double size = fabs(acceleration), whole_steps = floor(size / of->step);
  return of->period * whole_steps * (size - 0.5 * of->step * (whole_steps + 1.0));
}

/* x of y: the root of the module's second equation. */
static double root_of(double share) {
  const double whole_steps = floor(0.5 * (sqrt(1.0 + 8.0 * most_of(share, 0.0)) - 1.0));
  return (share + 0.5 * whole_steps * (whole_steps + 1.0)) / (whole_steps + 1.0);
}

/* The velocity once the acceleration is zero. */
static double at_rest_of_push(const limits* of, double velocity, double acceleration) {
  const double sign = acceleration > 0.0 ? 1.0 : acceleration < 0.0 ? -1.0 : acceleration;
  return velocity + sign * coming(of, acceleration);
}

/* The longest time in which a joint comes to rest [s]. */
static double seconds_of(const limits* of, double jerk, double velocity, double acceleration) {
  const double rest = fabs(at_rest_of_push(of, velocity, acceleration));
  const double after = rest * jerk < of->most * of->most ? 2.0 * sqrt(rest / jerk) : rest / of->most + of->most / jerk;
  return fabs(acceleration) / jerk + after;
}

/* The velocities of one joint in `periods` periods, `stride` numbers apart. */
static void brake(const limits* of, double velocity, double acceleration, long long periods, long long stride,
                  double* found) {
  const double side = at_rest_of_push(of, velocity, acceleration) < 0.0 ? -1.0 : 1.0;
  const double speed = side * velocity, push = side * acceleration;
  double sum = 0.0, before = speed;
  long long first = 0; /* the period in which it is too late to come to rest at zero: from there on it backs off */
  for (; first < periods; ++first) {
    const double pushed = most_of(push - (double)(first + 1) * of->step, -of->most), next = sum + pushed;
    if (pushed < 0.0 && speed + of->period * next < coming(of, pushed)) break;
    sum = next;
  }
  if (first == periods) first = 0;
  sum = 0.0;
  for (long long k = 0; k < periods; ++k) {
    if (k < first) {
      sum += most_of(push - (double)(k + 1) * of->step, -of->most);
    } else {
      if (k == first && k > 0) before = speed + of->period * sum;
      sum += least_of(of->step * ((double)(k - first) - root_of(before / (of->period * of->step))), 0.0);
    }
    const double speeds = speed + of->period * sum;
    found[k * stride] = k >= first && fabs(speeds) < REST ? 0.0 : side * speeds;
  }
}

/* Joints (n) in a number of states. */
typedef struct {
  long long n, states;
  double period;
  const double *most, *jerk, *velocity, *acceleration;
} joints;

static limits limits_of(const joints* of, long long k) {
  const long long joint = k % of->n;
  return (limits){of->most[joint], of->period * of->jerk[joint], of->period};
}

/* In how many periods all come to rest, at most; MOST_PERIODS if they are more, or if that is no number. */
static long long periods_of(const joints* of) {
  double seconds = 0.0;
  for (long long k = 0; k < of->states * of->n; ++k) {
    const limits own = limits_of(of, k);
    const double each = seconds_of(&own, of->jerk[k % of->n], of->velocity[k], of->acceleration[k]);
    if (!(each <= seconds)) seconds = each;
  }
  const double periods = ceil(seconds / of->period) + SPARE;
  return periods < MOST_PERIODS ? (long long)periods : MOST_PERIODS;
}

/* The velocities (periods, states, n) of all. */
static void brake_all(const joints* of, long long periods, double* found) {
  for (long long k = 0; k < of->states * of->n; ++k) {
    const limits own = limits_of(of, k);
    brake(&own, of->velocity[k], of->acceleration[k], periods, of->states * of->n, found + k);
  }
}

static double clipped(double value, double least, double most) { return least_of(most_of(value, least), most); }

/* The least and the greatest velocity (2, n) of the next period, from one state. */
static void window(const joints* of, const double* fastest, double* found) {
  for (long long k = 0; k < of->n; ++k) {
    const limits own = limits_of(of, k);
    const double velocity = of->velocity[k], acceleration = of->acceleration[k], scale = own.period * own.step;
    const double least = clipped(acceleration - own.step, -own.most, own.most);
    const double most = clipped(acceleration + own.step, -own.most, own.most);
    const double up = clipped(root_of((fastest[k] - velocity) / scale) * own.step, least, most);
    const double down = clipped(-(root_of((fastest[k] + velocity) / scale) * own.step), least, most);
    found[k] = velocity + own.period * least_of(down, up);
    found[of->n + k] = velocity + own.period * most_of(down, up);
  }
}

/* --- from Python ------------------------------------------------------------------------------------------------ */

WRAPPER(call_braked) {
  arguments taken = begin("braked", given, count);
  joints of = {.period = number(&taken, "period")};
  of.most = numbers(&taken, "most", SHAPE(ANY));
  of.n = taken.shape[0];
  of.jerk = numbers(&taken, "jerk", SHAPE(of.n));
  of.velocity = numbers(&taken, "velocity", SHAPE(ANY, of.n));
  of.states = taken.shape[0];
  of.acceleration = numbers(&taken, "acceleration", SHAPE(of.states, of.n));
  double* found = written(&taken, "found", SHAPE(ANY, of.states, of.n));
  const long long room = taken.shape[0];
  long long periods = 0;
  if (ready(&taken)) {
    periods = periods_of(&of);
    if (periods <= room) WITHOUT_LOCK(brake_all(&of, periods, found));
  }
  return ended(&taken, PyLong_FromLongLong(periods));
}

WRAPPER(call_braking_window) {
  arguments taken = begin("braking_window", given, count);
  joints of = {.states = 1, .period = number(&taken, "period")};
  of.most = numbers(&taken, "most", SHAPE(ANY));
  of.n = taken.shape[0];
  of.jerk = numbers(&taken, "jerk", SHAPE(of.n));
  of.velocity = numbers(&taken, "velocity", SHAPE(of.n));
  of.acceleration = numbers(&taken, "acceleration", SHAPE(of.n));
  const double* fastest = numbers(&taken, "fastest", SHAPE(of.n));
  double* found = written(&taken, "found", SHAPE(2, of.n));
  if (ready(&taken)) WITHOUT_LOCK(window(&of, fastest, found));
  return ended(&taken, none());
}

PyMethodDef braking_functions[] = {
    FUNCTION("braking_window", call_braking_window, "Velocities from which joints can brake."),
    FUNCTION("braked", call_braked, "Velocities of joints that brake; returns in how many periods they are at rest."),
    END_OF_FUNCTIONS,
};
