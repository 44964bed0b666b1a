#include "gjk.h"

#include "../../distance/compiled/clones.h"
#include "../../distance/compiled/vectors.h"

enum { LANES = 8, CLUSTER = 32, ROUNDS = 64, CORNERS = ROUNDS + 4, FACES = 2 * CORNERS, EDGES = 3 * FACES };

#define RELATIVE_GAP 1e-10 /* relative difference of a squared distance and its lower bound that is good enough */
#define TOUCHING 1e-7      /* [m] bodies so close count as overlapping, as the normal is lost in rounding */
#define DEPTH_GAP 1e-9     /* [m] difference of a depth and its bound that is good enough */
#define NO_HEIGHT 1e-10    /* [m] above a face that is no height */

static void copy(const double* from, double* to) {
  for (int i = 0; i < 3; ++i) to[i] = from[i];
}

/* --- supports --------------------------------------------------------------------------------------------------- */

/* The vertex that is farthest along v of each lane, eight lanes looked at at once: those of rows `from` to `to`, and those
   that are there already; of equal ones the first. */
INLINE void look(const solid* body, const double* v, long long from, long long to, double* best, long long* at) {
  const double *restrict x = body->rows, *restrict y = x + body->width, *restrict z = y + body->width;
  for (long long k = from; k < to; k += LANES)
    for (int i = 0; i < LANES; ++i) {
      const double along = v[0] * x[k + i] + v[1] * y[k + i] + v[2] * z[k + i];
      at[i] = along > best[i] ? k : at[i];
      best[i] = along > best[i] ? along : best[i];
    }
}

/* How far the balls around eight clusters reach along v, whose length is given. */
INLINE void reaches(const double* balls, long long width, const double* v, double length, double* found) {
  for (int i = 0; i < LANES; ++i)
    found[i] = v[0] * balls[i] + v[1] * balls[width + i] + v[2] * balls[2 * width + i] + length * balls[3 * width + i];
}

/* The same of all vertices: first those of the cluster that reaches farthest, then of those that reach beyond what is
   found. */
INLINE void look_by_clusters(const solid* body, const double* v, double* best, long long* at) {
  const double* balls = body->rows + 3 * body->width;
  const double length = norm(v);
  double reach[LANES], most = -INFINITY;
  long long first = 0;
  for (long long k = 0; k < body->clusters; k += LANES) {
    reaches(balls + k, body->clusters, v, length, reach);
    for (int i = 0; i < LANES; ++i) {
      first = reach[i] > most ? k + i : first;
      most = reach[i] > most ? reach[i] : most;
    }
  }
  look(body, v, CLUSTER * first, CLUSTER * (first + 1), best, at);
  most = best[0];
  for (int i = 1; i < LANES; ++i) most = best[i] > most ? best[i] : most;
  for (long long k = 0; k < body->clusters; k += LANES) {
    reaches(balls + k, body->clusters, v, length, reach);
    for (int i = 0; i < LANES; ++i) {
      if (!(reach[i] > most) || k + i == first) continue;
      look(body, v, CLUSTER * (k + i), CLUSTER * (k + i + 1), best, at);
      for (int j = 0; j < LANES; ++j) most = best[j] > most ? best[j] : most;
    }
  }
}

/* The vertex that is farthest along v. */
CLONES
static void farthest(const solid* body, const double* v, double* found) {
  double best[LANES];
  long long at[LANES], which = 0;
  for (int i = 0; i < LANES; ++i) {
    best[i] = -INFINITY;
    at[i] = 0;
  }
  if (body->clusters)
    look_by_clusters(body, v, best, at);
  else
    look(body, v, 0, body->width, best, at);
  for (int i = 1; i < LANES; ++i)
    if (best[i] > best[which]) which = i;
  for (int i = 0; i < 3; ++i) found[i] = body->rows[i * body->width + at[which] + which];
}

/* The point of a body, without its ball, that is farthest along v, all in its own frame. */
static void support(const solid* body, const double* v, double* point) {
  const double aside = sqrt(v[0] * v[0] + v[1] * v[1]);
  farthest(body, v, point);
  if (body->disc != 0.0 && aside > 0.0)
    for (int i = 0; i < 2; ++i) point[i] += body->disc * v[i] / aside;
  if (!body->radii) return;
  const double *radii = body->radii, scaled[3] = {radii[0] * v[0], radii[1] * v[1], radii[2] * v[2]};
  const double length = norm(scaled);
  for (int i = 0; length > 0.0 && i < 3; ++i) point[i] += radii[i] * scaled[i] / length;
}

/* A point p of the difference a − b, and its point of a. */
typedef struct {
  double p[3], a[3];
} corner;

/* The corner of a − b that is farthest along v. */
static corner corner_along(const two_solids* of, const double* v) {
  const double opposite[3] = {-v[0], -v[1], -v[2]};
  double local[3], own[3], theirs[3];
  corner found;
  turned_back(of->place, v, local);
  support(of->a, local, own);
  placed(of->place, own, found.a);
  support(of->b, opposite, theirs);
  difference(found.a, theirs, found.p);
  return found;
}

/* --- apart: the simplex of a − b that is nearest to the origin ---------------------------------------------------- */

typedef struct {
  int count;
  corner at[4];
  double share[4]; /* of the corners in the nearest point */
} simplex;

/* Products of the edges e_i = p_i − p of a simplex from one of its corners p. */
typedef struct {
  double edge[3][3], product[3][3], away[3]; /* e_i, e_i·e_j, −e_i·p */
} gram;

static void make_gram(gram* of, int count, const corner* const* at, const double* p) {
  for (int i = 0; i < count; ++i) {
    difference(at[i]->p, p, of->edge[i]);
    of->away[i] = -dot(of->edge[i], p);
    for (int j = 0; j <= i; ++j) of->product[i][j] = of->product[j][i] = dot(of->edge[i], of->edge[j]);
  }
}

/* The weights w of `count` of the edges for which p + Σ w_i e_i is orthogonal to all of them, by Cramer's rule. Returns 0
   where they are not independent. */
static int weigh(const gram* of, int count, const int* of_edges, double* w) {
  const int i = of_edges[0], j = of_edges[count > 1], k = of_edges[count > 2 ? 2 : 0];
  const double(*g)[3] = of->product, *a = of->away;
  const double plane = g[i][i] * g[j][j] - g[i][j] * g[i][j];
  if (count == 1) {
    if (!(g[i][i] > 0.0)) return 0;
    w[0] = a[i] / g[i][i];
    return 1;
  }
  if (!(plane > 1e-14 * g[i][i] * g[j][j])) return 0;
  if (count == 2) {
    w[0] = (g[j][j] * a[i] - g[i][j] * a[j]) / plane;
    w[1] = (g[i][i] * a[j] - g[i][j] * a[i]) / plane;
    return 1;
  }
  const double second = g[i][i] * g[k][k] - g[i][k] * g[i][k], first = g[j][j] * g[k][k] - g[j][k] * g[j][k];
  const double ij = g[i][k] * g[j][k] - g[i][j] * g[k][k], ik = g[i][j] * g[j][k] - g[i][k] * g[j][j];
  const double jk = g[i][j] * g[i][k] - g[i][i] * g[j][k], volume = g[i][i] * first + g[i][j] * ij + g[i][k] * ik;
  if (!(volume > 1e-14 * plane * g[k][k])) return 0;
  w[0] = (first * a[i] + ij * a[j] + ik * a[k]) / volume;
  w[1] = (ij * a[i] + second * a[j] + jk * a[k]) / volume;
  w[2] = (ik * a[i] + jk * a[j] + plane * a[k]) / volume;
  return 1;
}

/* Reduce a simplex to the face, among those with its last corner, that is nearest to the origin; v is the nearest
   point. */
static void reduce(simplex* of, double* v) {
  const int last = of->count - 1;
  const corner* at[3] = {of->at, of->at + 1, of->at + 2};
  const double* p = of->at[last].p;
  double least = dot(p, p), share[3], kept = 1.0;
  int best = 0;
  gram from;
  of->count = 0;
  if (!(least >= 0.0)) return; /* of what is not a number */
  make_gram(&from, last, at, p);
  copy(p, v);
  for (int mask = 1; mask < 1 << last; ++mask) {
    int of_edges[3], count = 0, inside = 1;
    double w[3], rest = 1.0, found[3];
    for (int i = 0; i < last; ++i)
      if (mask >> i & 1) of_edges[count++] = i;
    if (!weigh(&from, count, of_edges, w)) continue;
    copy(p, found);
    for (int i = 0; i < count; ++i) {
      inside = inside && w[i] > 0.0;
      rest -= w[i];
      for (int j = 0; j < 3; ++j) found[j] += w[i] * from.edge[of_edges[i]][j];
    }
    if (!inside || !(rest > 0.0) || !(dot(found, found) < least)) continue;
    least = dot(found, found);
    best = mask;
    kept = rest;
    for (int i = 0; i < count; ++i) share[i] = w[i];
    copy(found, v);
  }
  for (int i = 0; i < last; ++i) {
    if (!(best >> i & 1)) continue;
    of->share[of->count] = share[of->count];
    of->at[of->count++] = of->at[i];
  }
  of->share[of->count] = kept;
  of->at[of->count++] = of->at[last];
}

static int is_among(const simplex* of, const double* p) {
  for (int i = 0; i < of->count; ++i)
    if (p[0] == of->at[i].p[0] && p[1] == of->at[i].p[1] && p[2] == of->at[i].p[2]) return 1;
  return 0;
}

/* The distance of the bodies without their balls, its normal and the nearest point of a, as `signed_distance`, or an upper
   bound of it that is at most `near`; or −1, with a simplex in which the origin lies, or nearly. */
static double apart(const two_solids* of, double near, double far, simplex* at, double* normal, double* point) {
  double v[3], gap = -INFINITY, length = 0.0;
  const double away[3] = {-normal[0], -normal[1], -normal[2]};
  at->count = 1;
  at->share[0] = 1.0;
  at->at[0] = corner_along(of, away);
  copy(at->at[0].a, point);
  copy(at->at[0].p, v);
  if (dot(normal, v) > far) return dot(normal, v);
  for (int round = 0; round < ROUNDS; ++round) {
    const double square = dot(v, v), back[3] = {-v[0], -v[1], -v[2]};
    length = sqrt(square);
    if (length < TOUCHING) return -1.0;
    if (length <= near) return length;
    const corner next = corner_along(of, back);
    gap = dot(v, next.p) / length;
    for (int i = 0; i < 3; ++i) normal[i] = v[i] / length;
    if (gap > far || length * (length - gap) <= RELATIVE_GAP * square || is_among(at, next.p)) break;
    at->at[at->count++] = next;
    reduce(at, v);
    if (at->count == 4 || at->count == 0) return -1.0;
    if (!(dot(v, v) < square)) break;
  }
  for (int j = 0; j < 3; ++j) {
    point[j] = 0.0;
    for (int i = 0; i < at->count; ++i) point[j] += at->share[i] * at->at[i].a[j];
  }
  return gap > 0.0 ? gap : -1.0;
}

/* --- overlapping: the face of a − b that is nearest to the origin, from inside ----------------------------------- */

/* A face of a polytope: its corners, in order around its outward unit normal, and n·p of them. */
typedef struct {
  int at[3];
  double normal[3], height;
} face;

/* A polytope within a − b that grows, and the least height of a plane around a − b so far, with its normal and the point
   of a in it. */
typedef struct {
  const two_solids* of;
  int corners, faces;
  corner at[CORNERS];
  face face[FACES];
  double depth, outward[3], point[3];
} polytope;

/* The corner along a unit vector; its plane bounds the depth. */
static corner bounded(polytope* grown, const double* n) {
  const corner found = corner_along(grown->of, n);
  const double height = dot(n, found.p);
  if (height < grown->depth) {
    grown->depth = height;
    copy(n, grown->outward);
    copy(found.a, grown->point);
  }
  return found;
}

/* Add the face with these corners, if it is one. */
static int add_face(polytope* grown, int i, int j, int k) {
  double first[3], second[3];
  if (grown->faces == FACES) return 0;
  face* added = grown->face + grown->faces;
  *added = (face){.at = {i, j, k}};
  difference(grown->at[j].p, grown->at[i].p, first);
  difference(grown->at[k].p, grown->at[i].p, second);
  cross(first, second, added->normal);
  const double length = norm(added->normal);
  if (!(length > 1e-12 * (dot(first, first) + dot(second, second)))) return 0;
  for (int row = 0; row < 3; ++row) added->normal[row] /= length;
  added->height = dot(added->normal, grown->at[i].p);
  ++grown->faces;
  return 1;
}

/* A unit vector that is orthogonal to the first `count` corners' plane or line; any unit vector without corners. */
static void orthogonal(const polytope* grown, int count, double* n) {
  double first[3] = {1.0, 0.0, 0.0}, second[3];
  if (count > 1) difference(grown->at[1].p, grown->at[0].p, first);
  if (count > 2) {
    difference(grown->at[2].p, grown->at[0].p, second);
  } else {
    int least = 0;
    for (int i = 1; i < 3; ++i)
      if (fabs(first[i]) < fabs(first[least])) least = i;
    for (int i = 0; i < 3; ++i) second[i] = i == least;
  }
  cross(first, second, n);
  const double length = norm(n);
  for (int i = 0; i < 3; ++i) n[i] /= length;
}

/* Begin with a simplex, completed to a tetrahedron. Returns 0 where a − b is flat. */
static int begin(polytope* grown, const simplex* from) {
  double n[3], aside[3];
  grown->at[0] = from->count ? from->at[0] : bounded(grown, (const double[3]){1.0, 0.0, 0.0});
  grown->corners = 1;
  for (int i = 1; i < from->count && i < 3; ++i) grown->at[grown->corners++] = from->at[i];
  while (grown->corners < 4) {
    orthogonal(grown, grown->corners, n);
    const double opposite[3] = {-n[0], -n[1], -n[2]};
    const corner up = from->count == 4 && grown->corners == 3 ? from->at[3] : bounded(grown, n);
    const corner down = bounded(grown, opposite);
    difference(up.p, grown->at[0].p, aside);
    const double above = fabs(dot(aside, n));
    difference(down.p, grown->at[0].p, aside);
    const double below = fabs(dot(aside, n));
    if (!(most_of(above, below) > NO_HEIGHT)) return 0;
    grown->at[grown->corners++] = from->count == 4 && above > NO_HEIGHT ? up : above > below ? up : down;
  }
  difference(grown->at[3].p, grown->at[0].p, aside);
  orthogonal(grown, 3, n);
  const int below = dot(aside, n) > 0.0; /* the first three are seen from below if the fourth is above them */
  const int turn[4][3] = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
  grown->faces = 0;
  for (int i = 0; i < 4; ++i)
    if (!add_face(grown, turn[i][0], turn[i][below ? 2 : 1], turn[i][below ? 1 : 2])) return 0;
  return 1;
}

/* Replace the faces that a new corner is above by those that it has with the edges around them. Returns 0 where rounding
   allows none. */
static int grow(polytope* grown, const corner* added) {
  int edges[EDGES][2], count = 0;
  if (grown->corners == CORNERS) return 0;
  for (int row = 0; row < grown->faces;) {
    const face seen = grown->face[row];
    if (!(dot(seen.normal, added->p) - seen.height > NO_HEIGHT)) {
      ++row;
      continue;
    }
    grown->face[row] = grown->face[--grown->faces];
    for (int i = 0; i < 3; ++i) {
      const int from = seen.at[i], to = seen.at[(i + 1) % 3];
      int other = 0;
      while (other < count && !(edges[other][0] == to && edges[other][1] == from)) ++other;
      if (other < count) {
        --count;
        edges[other][0] = edges[count][0];
        edges[other][1] = edges[count][1];
      } else {
        edges[count][0] = from;
        edges[count++][1] = to;
      }
    }
  }
  grown->at[grown->corners] = *added;
  for (int i = 0; i < count; ++i)
    if (!add_face(grown, edges[i][0], edges[i][1], grown->corners)) return 0;
  ++grown->corners;
  return count > 0;
}

/* The point of a that comes to the foot of the origin on the nearest faces, which lie in one plane: on that of them which
   has the foot inside, or nearly. */
static void deepest(const polytope* grown, double* point) {
  double most = -INFINITY;
  for (int row = 0; row < grown->faces; ++row) {
    const face* of = grown->face + row;
    const corner* at[3] = {grown->at + of->at[0], grown->at + of->at[1], grown->at + of->at[2]};
    double w[2] = {0.0};
    gram from;
    if (of->height > grown->depth + DEPTH_GAP) continue;
    make_gram(&from, 2, at + 1, at[0]->p);
    (void)weigh(&from, 2, (const int[]){0, 1}, w);
    const double share[3] = {1.0 - w[0] - w[1], w[0], w[1]}, least = least_of(share[0], least_of(w[0], w[1]));
    if (!(least > most)) continue;
    most = least;
    for (int j = 0; j < 3; ++j) point[j] = share[0] * at[0]->a[j] + share[1] * at[1]->a[j] + share[2] * at[2]->a[j];
  }
}

/* How deep the bodies overlap without their balls, with the normal and the deepest point of a. */
static double overlap(const two_solids* of, const simplex* from, double* normal, double* point) {
  polytope grown;
  grown.of = of;
  grown.depth = INFINITY;
  (void)bounded(&grown, (const double[3]){-normal[0], -normal[1], -normal[2]});
  int goes_on = begin(&grown, from);
  while (goes_on) {
    const face* nearest = grown.face;
    for (int row = 1; row < grown.faces; ++row)
      if (grown.face[row].height < nearest->height) nearest = grown.face + row;
    const face found = *nearest;
    const corner next = bounded(&grown, found.normal);
    const double height = dot(found.normal, next.p);
    if (height - found.height <= DEPTH_GAP) {
      if (height > grown.depth + DEPTH_GAP) break; /* only where rounding spoilt the polytope */
      grown.depth = height;
      copy(found.normal, grown.outward);
      deepest(&grown, grown.point);
      break;
    }
    goes_on = grow(&grown, &next);
  }
  for (int i = 0; i < 3; ++i) normal[i] = -grown.outward[i];
  copy(grown.point, point);
  return grown.depth;
}

double signed_distance(const two_solids* of, double far, double* normal, double* point) {
  const double balls = of->a->ball + of->b->ball;
  simplex at;
  double distance = apart(of, -INFINITY, far + balls, &at, normal, point);
  if (distance < 0.0) distance = -overlap(of, &at, normal, point);
  for (int i = 0; i < 3; ++i) point[i] -= of->a->ball * normal[i];
  return distance - balls;
}

double gap_of(const two_solids* of, double near, double far, double* normal) {
  const double balls = of->a->ball + of->b->ball;
  double point[3];
  simplex at;
  return apart(of, near + balls, far + balls, &at, normal, point) - balls;
}

double reach_along(const solid* body, const double* v) {
  double point[3];
  support(body, v, point);
  return dot(v, point) + body->ball * norm(v);
}
