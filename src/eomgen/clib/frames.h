/* frames.h: frames of a robot and what is between the base and them, as tables that kinematics.h reads. */
#ifndef EOM_FRAMES_H
#define EOM_FRAMES_H

/* Nodes are the base, the bodies, and the frames, each behind its body.  A run is one of them, or several that follow
 * each other.  Axes are those of joint coordinates, body by body.  Sizes are those of tables, so that compilers know
 * them. */
#define EOM_TABLES_OF_FRAMES(nodes, runs, places, frames, bodies, axes) \
    struct { \
        int run_of[nodes];     /* of each node */ \
        int behind[runs];      /* node that each run follows, or -1 */ \
        int turned[nodes];     /* angles that each node needs of its run */ \
        int first[runs];       /* angle of each run */ \
        int place[places];     /* of each angle */ \
        int body_of[frames];   /* of each frame, or -1: the base */ \
        int is_full[frames];   /* 1: its Jacobian has no zeros */ \
        int parent[bodies];    /* of each body, or -1 */ \
        int first_axis[bodies]; \
        int count[bodies];     /* axes of each body */ \
        int is_rotation[axes]; \
        int column[axes];      /* coordinate of each axis, where several may be of one */ \
        int has_columns;       /* 0: axis i is of coordinate i */ \
        int first_frame;       /* node of frame 0 */ \
        int angles;            /* that turn between the base and a frame, at most */ \
        int n;                 /* coordinates */ \
    }
#endif
