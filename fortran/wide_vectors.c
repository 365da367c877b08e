/* Whether the processor has the vectors of x86-64-v3, for which kernels are compiled a second time. */
int pyblast_wide_vectors(void)
{
#ifdef PYBLAST_WIDE
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
    return 0;
#endif
}
