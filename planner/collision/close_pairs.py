"""The loops of the broad phase in C: which balls reach which boxes, pair by pair and sample by sample.

In: balls (centre, reach) on joints, boxes in the world or on joints, and placements of the joints at samples. Out: rows
(sample, pair), pair by pair. `broad_phase` has the same in NumPy, for machines without a compiler. Rounding may decide
differently where a ball only just touches a box; there the distance is positive anyway.
"""

from __future__ import annotations

import ctypes
import functools
import re
from typing import Any

import numpy as np

from hdplan.distance.symbolic.c_library import c_library
from hdplan.scenes.array_types import Array, Mask, Rows

ROOM = 1 << 13  # rows that there is room for at first

SOURCE = """
/* Points (count, 3) in the frames of joints, in the world at every sample: (batch, count, 3). */
void place(long long batch, long long joints, const double* placements, long long count, const long long* joint,
           const double* points, double* placed) {
  long long s, k;
  int i;
  for (s = 0; s < batch; ++s)
    for (k = 0; k < count; ++k) {
      const double *frame = placements + 12 * (s * joints + joint[k]), *p = points + 3 * k;
      for (i = 0; i < 3; ++i)
        *placed++ = frame[3 * i] * p[0] + frame[3 * i + 1] * p[1] + frame[3 * i + 2] * p[2] + frame[9 + i];
    }
}

/* Squared distance from a box, of a point given from its centre; `box` is its placement (4, 4), row by row. */
static double beyond(double x, double y, double z, const double* box, const double* half) {
  double total = 0.0;
  int i;
  for (i = 0; i < 3; ++i) {
    double along = x * box[i] + y * box[4 + i] + z * box[8 + i];
    double out = (along < 0.0 ? -along : along) - half[i];
    if (out > 0.0) total += out * out;
  }
  return total;
}

/* Boxes that stand. First by a ball around each body's whole motion. */
long long close_to_standing(long long batch, long long bodies, const double* centres, const double* reach,
                            const double* middles, const double* travels, long long pairs, const long long* pair,
                            const long long* body, const long long* box, const double* boxes, const double* half,
                            long long room, long long* samples, long long* found) {
  long long k, s, count = 0;
  for (k = 0; k < pairs; ++k) {
    long long a = body[k];
    const double *at = boxes + 16 * box[k], *size = half + 3 * box[k], *p = middles + 3 * a;
    double most = reach[a] + travels[a];
    if (!(beyond(p[0] - at[3], p[1] - at[7], p[2] - at[11], at, size) < most * most)) continue;
    most = reach[a] * reach[a];
    for (s = 0; s < batch; ++s) {
      p = centres + 3 * (s * bodies + a);
      if (beyond(p[0] - at[3], p[1] - at[7], p[2] - at[11], at, size) < most) {
        if (count < room) { samples[count] = s; found[count] = pair[k]; }
        ++count;
      }
    }
  }
  return count;
}

/* Boxes on joints, with their centres in the world (batch, number of boxes, 3) and the balls around them. */
long long close_to_moving(long long batch, long long bodies, const double* centres, const double* reach,
                          long long number, const double* origins, const double* balls, long long joints,
                          const double* placements, long long pairs, const long long* pair, const long long* body,
                          const long long* box, const long long* joint, const double* boxes, const double* half,
                          long long room, long long* samples, long long* found) {
  long long k, s, count = 0;
  for (k = 0; k < pairs; ++k) {
    long long a = body[k], b = box[k];
    double near = reach[a] + balls[b], most = reach[a] * reach[a];
    near *= near;
    for (s = 0; s < batch; ++s) {
      const double *p = centres + 3 * (s * bodies + a), *o = origins + 3 * (s * number + b);
      double x = p[0] - o[0], y = p[1] - o[1], z = p[2] - o[2];
      if (x * x + y * y + z * z < near) {
        const double* frame = placements + 12 * (s * joints + joint[k]);
        if (beyond(frame[0] * x + frame[3] * y + frame[6] * z, frame[1] * x + frame[4] * y + frame[7] * z,
                   frame[2] * x + frame[5] * y + frame[8] * z, boxes + 16 * b, half + 3 * b) < most) {
          if (count < room) { samples[count] = s; found[count] = pair[k]; }
          ++count;
        }
      }
    }
  }
  return count;
}

/* Of rows (sample, pair), pair by pair, those that no plane of the second body separates by `least`: `planes` are
   (normal, support) in the second body's frame, those of box b from first[b] on. The plane that separated a pair at the
   sample before is tried first. */
void not_separated(long long rows, const long long* sample, const long long* pair, long long joints,
                   const double* placements, const long long* joint_a, const long long* joint_b, const long long* body,
                   const long long* box, long long slots, const double* table, const long long* first,
                   const long long* number, const double* planes, double least, unsigned char* kept) {
  long long r, tried, before = -1, last = 0;
  for (r = 0; r < rows; ++r) {
    long long k = pair[r], i, j;
    const double *a = placements + 12 * (sample[r] * joints + joint_a[k]);
    const double *b = placements + 12 * (sample[r] * joints + joint_b[k]);
    const double *vertices = table + (4 * slots + 1) * body[k], *plane = planes + 4 * first[box[k]];
    double turn[9], shift[3], gap = 0.0;
    if (k != before) { before = k; last = 0; }
    for (i = 0; i < 3; ++i) {
      shift[i] = b[i] * (a[9] - b[9]) + b[3 + i] * (a[10] - b[10]) + b[6 + i] * (a[11] - b[11]);
      for (j = 0; j < 3; ++j) turn[3 * i + j] = b[i] * a[j] + b[3 + i] * a[3 + j] + b[6 + i] * a[6 + j];
    }
    kept[r] = 1;
    for (tried = 0; tried < number[box[k]]; ++tried) {
      long long which = tried == 0 ? last : (tried <= last ? tried - 1 : tried);
      const double* n = plane + 4 * which;
      double x = n[0] * turn[0] + n[1] * turn[3] + n[2] * turn[6], y = n[0] * turn[1] + n[1] * turn[4] + n[2] * turn[7];
      double z = n[0] * turn[2] + n[1] * turn[5] + n[2] * turn[8];
      gap = x * vertices[0] + y * vertices[1] + z * vertices[2];
      for (i = 1; i < slots; ++i) {
        double along = x * vertices[3 * i] + y * vertices[3 * i + 1] + z * vertices[3 * i + 2];
        gap = along < gap ? along : gap;
      }
      gap += n[0] * shift[0] + n[1] * shift[1] + n[2] * shift[2] - vertices[4 * slots] - n[3];
      if (gap > least) { kept[r] = 0; last = which; break; }
    }
  }
}
"""

LEAST = 1e-9  # [m] by which a plane must separate, so that rounding decides nothing


@functools.cache
def library() -> ctypes.CDLL | None:
    """The compiled loops; None without a C compiler."""
    found = c_library("close_pairs", SOURCE)
    if found is not None:
        for result, name, given in re.findall(r"^(void|long long) (\w+)\((.*?)\) {", SOURCE, re.M | re.S):
            function = getattr(found, name)
            function.restype = ctypes.c_longlong if result == "long long" else None
            function.argtypes = [_type(argument) for argument in given.split(",")]
    return found


def _type(argument: str) -> type:
    """The type of a declared argument: an array's address, a whole number or a number."""
    if "*" in argument:
        return ctypes.c_void_p
    return ctypes.c_longlong if "long long" in argument else ctypes.c_double


def placed(loops: ctypes.CDLL, placements: Array, joint: Rows, points: Array) -> Array:
    """Return points (k, 3) in the frames of joints (k,) in the world, at every sample (batch, k, 3)."""
    batch, joints = placements.shape[:2]
    result = np.empty((batch, len(points), 3))
    _call(loops.place, batch, joints, placements, len(points), joint, points, result)
    return result


def rows(loop: Any, *arguments: int | Array | Rows) -> tuple[Rows, Rows]:
    """Call `close_to_standing` or `close_to_moving` with what it is given, up to `room`; return samples and pairs
    (S,)."""
    room = ROOM
    while True:
        sample, pair = np.empty(room, np.int64), np.empty(room, np.int64)
        count = int(_call(loop, *arguments, room, sample, pair))
        if count <= room:
            return sample[:count], pair[:count]
        room = count


def not_separated(loops: ctypes.CDLL, sample: Rows, pair: Rows, *arguments: int | Array | Rows) -> Mask:
    """Return which rows (S,) no plane separates; `arguments` from `joints` to `planes` as in C."""
    kept = np.empty(len(sample), np.bool_)
    _call(loops.not_separated, len(sample), sample, pair, *arguments, LEAST, kept)
    return kept


def _call(function: Any, *arguments: float | Array | Rows | Mask) -> Any:
    """Call a C function with numbers and arrays, which it takes as contiguous."""
    given = [each if isinstance(each, int | float) else np.ascontiguousarray(each) for each in arguments]
    return function(*(each if isinstance(each, int | float) else each.__array_interface__["data"][0] for each in given))
