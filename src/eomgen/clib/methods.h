/* methods.h: coefficients of the methods; rows are stages, and EOM_C() makes numbers of the precision of states.  Those of explicit
 * and Rosenbrock methods are rendered from the table of methods (explicit_tableaus.h, tableaus.h). */
#include "explicit_methods.h"

enum { EOM_ROSENBROCK_STAGES = 6, EOM_INSIDE_STAGE = 7, EOM_STAGES_WITH_POWERS = 8, EOM_WORK_DEGREE = 5 };
enum { EOM_RADAU_STAGES = 5, EOM_RADAU_PAIRS = 2, EOM_RADAU_ROUNDS = 8 };

/* A Rosenbrock method, in the variables that spare products with the matrix (E. Hairer, G. Wanner, "Solving Ordinary Differential
 * Equations II", section IV.7). */
typedef struct {
    int stages;
    EOM_SCALAR diagonal;
    EOM_SCALAR a[EOM_ROSENBROCK_STAGES][EOM_ROSENBROCK_STAGES];
    EOM_SCALAR c[EOM_ROSENBROCK_STAGES][EOM_ROSENBROCK_STAGES];
    EOM_SCALAR b[EOM_ROSENBROCK_STAGES];
    EOM_SCALAR error[EOM_ROSENBROCK_STAGES];
    double shares[EOM_ROSENBROCK_STAGES];
    int begins[EOM_ROSENBROCK_STAGES]; /* whether a stage has the state and the time of the first one */
} EOM(rosenbrock_method);

/* A method with error control, by its number.  Work integrals: weights, of stages from 0 to the one at the end; with a degree
 * those of powers of the share of a step; and errors. */
enum { EOM_EXPLICIT_KIND, EOM_ROSENBROCK_KIND, EOM_RADAU_KIND };
typedef struct {
    int kind;
    int stages;      /* before the one at the end of a step */
    int powers;      /* stages that have powers */
    int degree;
    double exponent; /* of the error in the length of the next step */
    double works[EOM_STAGES_WITH_POWERS][EOM_WORK_DEGREE];
    double errors[EOM_STAGES_WITH_POWERS];
} eom_error_control;

#include "tableaus.h"

/* Radau IIA of five stages and order 9, and its error of order 5 (E. Hairer, G. Wanner, "Stiff differential equations solved by
 * Radau methods", Journal of Computational and Applied Mathematics 111, 1999, 93; "Solving Ordinary Differential Equations II",
 * section IV.8).  The inverse of its matrix is back diag(real, blocks of pairs) ahead. */
static const double eom_radau_shares[EOM_RADAU_STAGES] = { 0.05710419611451768, 0.2768430136381238, 0.5835904323689168, 0.8602401356562195, 1.0 };

static const EOM_SCALAR eom_radau_real = EOM_C(6.2867047517292765);

static const EOM_SCALAR eom_radau_pairs[EOM_RADAU_PAIRS][2] = {
    { EOM_C(5.70095329867179), EOM_C(3.2102656003085497) },
    { EOM_C(3.655694325463572), EOM_C(6.543736899360077) },
};

static const EOM_SCALAR eom_radau_ahead[EOM_RADAU_STAGES][EOM_RADAU_STAGES] = {
    { EOM_C(27.697693775684087), EOM_C(12.783337911304406), EOM_C(3.20848938671343), EOM_C(-0.9514904122489162), EOM_C(0.7415504960259897) },
    { EOM_C(-33.041880213519), EOM_C(-17.376953479063566), EOM_C(-0.17212906325400557), EOM_C(-0.09916977798254265), EOM_C(0.5312281158383066) },
    { EOM_C(-8.611443979875292), EOM_C(9.699991409528808), EOM_C(1.9147286396968743), EOM_C(2.41869200608494), EOM_C(-1.0474634879353375) },
    { EOM_C(5.344186437834912), EOM_C(4.593615567759161), EOM_C(-3.0363603234594243), EOM_C(1.050660190231459), EOM_C(-0.27277861186429625) },
    { EOM_C(3.748059807439805), EOM_C(-3.984965736343885), EOM_C(-1.0444156416080188), EOM_C(1.1840985681379486), EOM_C(-0.44991777015678036) },
};

static const EOM_SCALAR eom_radau_back[EOM_RADAU_STAGES][EOM_RADAU_STAGES] = {
    { EOM_C(0.013576867344947943), EOM_C(-0.011478515255229515), EOM_C(-0.01401985889287541), EOM_C(-0.010242047817908826), EOM_C(0.04767387729029572) },
    { EOM_C(0.0016179004017190875), EOM_C(-0.007668830749180163), EOM_C(0.024708578426518527), EOM_C(0.05017286451737106), EOM_C(-0.09433181918161143) },
    { EOM_C(0.07915785334744721), EOM_C(0.01939846399882895), EOM_C(0.08180035370375117), EOM_C(-0.23053953404341795), EOM_C(0.1027030453801259) },
    { EOM_C(0.41225608268046143), EOM_C(0.40760117128019907), EOM_C(0.19968242788680252), EOM_C(0.37789390224886127), EOM_C(0.46674413033249434) },
    { EOM_C(1.0), EOM_C(1.0), EOM_C(0.0), EOM_C(1.0), EOM_C(0.0) },
};

/* Of increments of stages, beside the first eigenvalue. */
static const EOM_SCALAR eom_radau_error[EOM_RADAU_STAGES] = { EOM_C(-27.78093394406464), EOM_C(3.641478498049213), EOM_C(-1.2525477211691187), EOM_C(0.5920031671845428), EOM_C(-0.2) };

/* Coefficients of powers of the share of a step, of stages in columns: of the polynomial through them, from the first power on. */
static const EOM_SCALAR eom_radau_inside[EOM_RADAU_STAGES][EOM_RADAU_STAGES] = {
    { EOM_C(27.78093394406464), EOM_C(-3.641478498049213), EOM_C(1.2525477211691187), EOM_C(-0.5920031671845428), EOM_C(0.2) },
    { EOM_C(-208.02785730090133), EOM_C(77.88337605511782), EOM_C(-29.167414317829696), EOM_C(14.111895563613205), EOM_C(-4.8) },
    { EOM_C(524.1878839694918), EOM_C(-264.89491356822634), EOM_C(137.90290440413477), EOM_C(-72.39587480540027), EOM_C(25.2) },
    { EOM_C(-543.8283560361325), EOM_C(317.67586907995275), EOM_C(-202.09087094360743), EOM_C(123.04335789978718), EOM_C(-44.8) },
    { EOM_C(199.88739542347736), EOM_C(-127.022853068795), EOM_C(92.10283313613321), EOM_C(-64.16737549081559), EOM_C(25.2) },
};

/* Newton's iteration that leaves more than so much of an error has new factors for the next step; the first one of a step is taken
 * to leave so much at least. */
#define EOM_RADAU_SLOW 1e-3
#define EOM_RADAU_TRUST 0.01

/* Changes below so much of what is allowed that do not become smaller are rounding. */
#define EOM_RADAU_ROUNDING 0.01

/* Gauss's rule of five nodes on [0, 1]. */
static const double eom_gauss_nodes[5] = { 0.04691007703066802, 0.23076534494715845, 0.5, 0.7692346550528415, 0.9530899229693319 };
static const double eom_gauss_weights[5] = { 0.11846344252809454, 0.23931433524968324, 0.2844444444444444, 0.23931433524968324, 0.11846344252809454 };
