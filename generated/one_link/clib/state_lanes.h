/* state_lanes.h: a state in every lane of a vector. */
#undef EOM_F
#undef EOM_REAL
#undef EOM_WIDTH
#undef EOM_BLOCK
#undef EOM_LANE_OF
#undef EOM_WHOLE
#undef EOM_HERE_OF
#define EOM_F(name) EOM(name##_lanes)
#define EOM_REAL lanes
#define EOM_WIDTH EOM_LANES
#define EOM_BLOCK 1
#define EOM_LANE_OF(x, l) EOM_LANE(x, l)
#define EOM_WHOLE(x) EOM_ALL_LANES(x)
#define EOM_HERE_OF(h) NULL
