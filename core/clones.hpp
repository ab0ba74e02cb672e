// Function multiversioning: one build carries a kernel for plain x86-64, AVX2 and AVX-512 and picks at load time.
// Contraction is off for every version (-ffp-contract=off), so all of them give the same bytes.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12
#define ADRL_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#elif defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) // older GCC knows no microarchitecture levels
#define ADRL_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define ADRL_CLONES
#endif

#if defined(__GNUC__) || defined(__clang__)
#define ADRL_INLINE inline __attribute__((always_inline))
#else
#define ADRL_INLINE inline
#endif
