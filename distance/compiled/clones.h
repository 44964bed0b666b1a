/* Functions compiled for several generations of x86-64, of which each process runs the widest that its processor has.
   Wider vectors are faster and change no bit: sums keep their order, and no products are fused (-ffp-contract=off). */

#ifndef HDPLAN_CLONES_H
#define HDPLAN_CLONES_H

#include <stdlib.h> /* says which C library it is: the choice is made by a loader that knows IFUNC, glibc's */

#if defined(__x86_64__) && defined(__linux__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && \
    __GNUC__ >= 12 && !defined(__SANITIZE_ADDRESS__)
#define CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define CLONES
#endif

#endif
