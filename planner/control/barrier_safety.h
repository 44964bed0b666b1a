/* The shaping of the HD-SDF undone, for other loops. */

#ifndef HDPLAN_BARRIER_SAFETY_H
#define HDPLAN_BARRIER_SAFETY_H

/* The separation u with D = Phi(Phi(u)), and dD/du there to *slope; 0 and 0 for 0. */
double straightened(double distance, double gamma, double length, double* slope);

#endif
