/* state_one.h: one state in each number. */
#undef F
#undef REAL
#undef WIDTH
#undef BLOCK
#undef LANE_OF
#undef WHOLE
#undef HERE_OF
#define F(name) EOM(name)
#define REAL EOM_SCALAR
#define WIDTH 1
#define LANE_OF(x, l) (x)
#define WHOLE(x) (x)
#define HERE_OF(h) (h)
#if defined(EOM_RATES)
#define BLOCK 1
#else
#define BLOCK 4
#endif
