/* ---- the words of an instruction set begin: gcc writes loops of a few turns out from -O3 on only, and else keeps in memory what
   should be in registers: with -O2 rays took a quarter to a half longer */
#if HYI_GNU && !defined(__clang__)
#pragma GCC push_options
#pragma GCC optimize("peel-loops")
#endif
