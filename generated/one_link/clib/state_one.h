/* state_one.h: one state in each number. */
#undef EOM_F
#undef EOM_REAL
#undef EOM_WIDTH
#undef EOM_BLOCK
#undef EOM_LANE_OF
#undef EOM_WHOLE
#undef EOM_HERE_OF
#define EOM_F(name) EOM(name)
#define EOM_REAL EOM_SCALAR
#define EOM_WIDTH 1
#define EOM_LANE_OF(x, l) (x)
#define EOM_WHOLE(x) (x)
#define EOM_HERE_OF(h) (h)
#if defined(EOM_RATES)
#define EOM_BLOCK 1
#else
#define EOM_BLOCK 4
#endif
