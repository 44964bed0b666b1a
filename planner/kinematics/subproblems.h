/* The canonical subproblems of Paden and Kahan, as Elias and Wen put them together ("IK-Geo: Unified robot inverse
   kinematics using subproblem decomposition", 2025): angles about axes that bring vectors and points where they are wanted.
   Lengths in [m], angles in [rad]. Where `slack` is not 0, what just misses counts, and last steps make up for it. */

#ifndef HDPLAN_SUBPROBLEMS_H
#define HDPLAN_SUBPROBLEMS_H

#include "motions.h"

enum { PER_HALF = 10, FEW = 2 * PER_HALF }; /* angles of a conic on half a circle, and what they make */

static const double SPECIAL_CASE = 1e-3;   /* [m] or sine below which axes meet, or are parallel: last steps make up for it */

/* The angle by which `from` turns about h into the direction of `to`; `other` where either lies along h. */
double angle_between(const double* h, const double* from, const double* to, double other);

/* The angles by which `vector` turns about h so that its part along `along` is `value`. */
int to_part(const double* h, const double* vector, const double* along, double value, double slack, double other,
            double* angles);

/* The points of two axes that are nearest to each other; of parallel ones any such two. */
void feet(const axis* a, const axis* b, double* on_a, double* on_b);

/* The angles with E₁ E₂ E₃ w = t. With o₁, o₂ the feet of axes 1 and 2, d = o₂ − o₁, u = E₃ w − o₂ and τ = t − o₁, what
   a turn about axis 1 keeps gives
       d·R₂u = (|τ|² − |d|² − |u|²) / 2,     h₁·R₂u = h₁·τ,
   the parts of R₂u along d and along h₁'s part across h₂, at right angles to each other and to h₂. Without θ₂ that is
   a conic in (cos θ₃, sin θ₃); a line where axes 1 and 2 meet (d = 0) or are parallel. */
int place_point(const axis* axes, const double* w, const double* t, double slack, const double* other,
                double (*found)[3]);

#endif
