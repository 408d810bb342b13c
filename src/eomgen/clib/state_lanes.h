/* state_lanes.h: a state in every lane of a vector. */
#undef F
#undef REAL
#undef WIDTH
#undef BLOCK
#undef LANE_OF
#undef WHOLE
#undef HERE_OF
#define F(name) EOM(name##_lanes)
#define REAL lanes
#define WIDTH LANES
#define BLOCK 1
#define LANE_OF(x, l) LANE(x, l)
#define WHOLE(x) ALL(x)
#define HERE_OF(h) NULL
