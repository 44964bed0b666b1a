/* Functions compiled for several generations of x86-64, of which each process runs the widest that its processor has.
   Wider vectors are faster and change no bit: sums keep their order, and no products are fused (-ffp-contract=off). */

#ifndef HDPLAN_CLONES_H
#define HDPLAN_CLONES_H

#include <stdlib.h> /* defines which C library this is: only glibc's loader can choose */

#if defined(__clang__)
#define HAS_CLONES (__clang_major__ >= 14)
#elif defined(__GNUC__)
#define HAS_CLONES (__GNUC__ >= 12)
#else
#define HAS_CLONES 0
#endif

#if HAS_CLONES && defined(__x86_64__) && defined(__linux__) && defined(__GLIBC__) && !defined(HDPLAN_NO_CLONES)
#define CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define CLONES
#endif

/* For what clones call: as functions of their own, those would be compiled for the oldest processor. */
#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

#endif
