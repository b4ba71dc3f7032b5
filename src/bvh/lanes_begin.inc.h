/* ---- the words of an instruction set begin: gcc writes loops of a few turns out from -O3 on only, and else keeps in memory what
   should be in registers: with -O2 rays took 1.1 to 1.4 times as long, and 1.7 times without vectors */
#if HYI_GNU && !defined(__clang__)
#pragma GCC push_options
#pragma GCC optimize("peel-loops")
#endif
