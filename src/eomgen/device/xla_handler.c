/* Handlers of XLA's foreign functions: they put the functions of a kernel on XLA's stream by calls of the device's driver,
 * whose addresses come with the plan of a function.  The attribute "plan" of a call is the number of its plan.
 *
 * Arguments are (count, ...) in rows; results the one of the function, and bytes for what lives as long as the call: where
 * searches begin, a status of each state, and tiles of all arrays. */
#include "xla/ffi/api/c_api.h"

#include <stdint.h>
#include <stdio.h>
#include <string.h>

enum {
    BLOCK = 128,    /* threads of a block */
    TILE = 32,      /* states of a tile */
    LINE = 256,     /* bytes at whose multiples parts of the scratch memory begin */
    MOST = 24,      /* arrays of a function */
    STATUS_BITS = 32,
    ORDINAL = 9,    /* attribute of a pointer: the number of its device */
    TEXT = 512
};
#define WELL 0xFFFFFFFFu /* where no state is named */

/* Calls of the driver; each gives 0 where it is well.  Addresses on the device are numbers of 64 bits. */
typedef struct {
    int (*push)(void *context);
    int (*pop)(void **context);
    int (*launch)(void *function, unsigned int, unsigned int, unsigned int, unsigned int, unsigned int, unsigned int, unsigned int shared, void *stream, void **arguments, void **extra);
    int (*fill)(uint64_t place, unsigned int word, size_t words, void *stream);
    int (*to_host)(void *target, uint64_t source, size_t size, void *stream);
    int (*wait)(void *stream);
    int (*pointer)(void *found, int attribute, uint64_t place);
    int (*message)(int code, const char **text);
} driver;

/* What a function is: filled by Python, and there as long as the process.  Arrays that are read stand in front. */
typedef struct plan {
    uint64_t number;
    uint64_t h; /* numbers of parameters, on the device */
    const char *name;
    const char *device;
    void *context;
    const driver *calls;
    const uint64_t *sizes; /* numbers of a state, of each array */
    const char *const *labels;
    void *const *functions;
    const char *const *reasons; /* of the bits of a status */
    void *begin; /* what is read, into tiles */
    void *end;   /* what is written, out of them */
    void *find;  /* what is not well */
    int32_t ordinal;
    int32_t is_double;
    int32_t arrays; /* of which the last one is written */
    int32_t parts;  /* functions that are launched one behind the other */
    int32_t checks;
    const struct plan *next;
} plan;

static const plan *first_plan; /* added to by one thread at a time, read by others */

void eomgen_add_plan(plan *added)
{
    added->next = first_plan;
    __atomic_store_n(&first_plan, added, __ATOMIC_RELEASE);
}

static XLA_FFI_Error *refused(const XLA_FFI_CallFrame *frame, XLA_FFI_Error_Code code, const char *text)
{
    XLA_FFI_Error_Create_Args args = { XLA_FFI_Error_Create_Args_STRUCT_SIZE, NULL, text, code };
    return frame->api->XLA_FFI_Error_Create(&args);
}

/* Find the plan that a call names; NULL where there is none. */
static const plan *plan_of(const XLA_FFI_CallFrame *frame)
{
    const plan *found = __atomic_load_n(&first_plan, __ATOMIC_ACQUIRE);
    uint64_t number = 0;
    for (int64_t i = 0; i < frame->attrs.size; ++i) {
        const XLA_FFI_ByteSpan *name = frame->attrs.names[i];
        const XLA_FFI_Scalar *scalar = frame->attrs.attrs[i];
        if ((name->len == 4) && (memcmp(name->ptr, "plan", 4) == 0) && (frame->attrs.types[i] == XLA_FFI_AttrType_SCALAR) && (scalar->dtype == XLA_FFI_DataType_S64)) {
            (void)memcpy(&number, scalar->value, sizeof number);
        }
    }
    while ((found != NULL) && (found->number != number)) { found = found->next; }
    return found;
}

/* Answer what XLA asks of a handler when it is registered; 0 where this is a call. */
static int is_question(const XLA_FFI_CallFrame *frame)
{
    if ((frame->extension_start == NULL) || (frame->extension_start->type != XLA_FFI_Extension_Metadata)) { return 0; }
    XLA_FFI_Metadata *const about = ((XLA_FFI_Metadata_Extension *)frame->extension_start)->metadata;
    about->api_version.major_version = XLA_FFI_API_MAJOR;
    about->api_version.minor_version = XLA_FFI_API_MINOR;
    about->traits = 0;
    return 1;
}

/* The call of one function: its plan, arrays, tiles, scratch memory and stream. */
typedef struct {
    const XLA_FFI_CallFrame *frame;
    const plan *p;
    uint64_t count;
    uint64_t rows[MOST];
    uint64_t tiles[MOST];
    uint64_t searched; /* where searches begin */
    uint64_t status;
    void *stream;
} call;

static uint64_t whole(uint64_t size, uint64_t part) { return (size + part - 1) / part * part; }

/* Say what the driver says of a code that is not 0. */
static XLA_FFI_Error *failure(const call *c, const char *what, int code)
{
    char text[TEXT];
    const char *said = NULL;
    if (code == 0) { return NULL; }
    (void)c->p->calls->message(code, &said);
    (void)snprintf(text, sizeof text, "%s: %s failed on %s: %s (%d)", c->p->name, what, c->p->device, (said != NULL) ? said : "an error without a text", code);
    return refused(c->frame, XLA_FFI_Error_Code_INTERNAL, text);
}

static int launched(const call *c, void *function, uint64_t threads, void **arguments)
{
    const unsigned int blocks = (unsigned int)((threads + BLOCK - 1) / BLOCK);
    return c->p->calls->launch(function, blocks, 1, 1, BLOCK, 1, 1, 0, c->stream, arguments, NULL);
}

/* Look at an array: its dtype, how many numbers it has, and on which device it lies. */
static XLA_FFI_Error *looked_at(call *c, int place, const XLA_FFI_Buffer *buffer)
{
    const plan *const p = c->p;
    char text[TEXT];
    uint64_t numbers = 1;
    int found = -1;
    for (int64_t i = 0; i < buffer->rank; ++i) { numbers *= (uint64_t)buffer->dims[i]; }
    if (place == 0) { c->count = (buffer->rank > 0) ? (uint64_t)buffer->dims[0] : 0; }
    if ((buffer->dtype != ((p->is_double != 0) ? XLA_FFI_DataType_F64 : XLA_FFI_DataType_F32)) || (numbers != c->count * p->sizes[place])) {
        (void)snprintf(text, sizeof text, "%s: %s has %llu numbers; allowed: %llu of float%d for %llu states", p->name, p->labels[place], (unsigned long long)numbers, (unsigned long long)(c->count * p->sizes[place]), (p->is_double != 0) ? 64 : 32, (unsigned long long)c->count);
        return refused(c->frame, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
    }
    c->rows[place] = (uint64_t)(uintptr_t)buffer->data;
    if ((numbers > 0) && ((p->calls->pointer(&found, ORDINAL, c->rows[place]) != 0) || (found != p->ordinal))) {
        (void)snprintf(text, sizeof text, "%s: %s lies on another device; allowed: arrays on %s", p->name, p->labels[place], p->device);
        return refused(c->frame, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
    }
    return NULL;
}

/* Take what a call brings, and divide its scratch memory. */
static XLA_FFI_Error *taken(call *c)
{
    const XLA_FFI_CallFrame *const frame = c->frame;
    const plan *const p = c->p;
    const int reads = p->arrays - 1;
    XLA_FFI_Error *error = NULL;
    if ((frame->args.size != reads) || (frame->rets.size != 2) || (p->arrays > MOST)) { return refused(frame, XLA_FFI_Error_Code_INTERNAL, "eomgen: a call that is none of its functions"); }
    for (int i = 0; (i < p->arrays) && (error == NULL); ++i) {
        error = looked_at(c, i, (i < reads) ? frame->args.args[i] : frame->rets.rets[0]);
    }
    if (error != NULL) { return error; }
    const XLA_FFI_Buffer *const scratch = frame->rets.rets[1];
    const uint64_t item = (p->is_double != 0) ? 8 : 4;
    uint64_t used = whole(4 * (uint64_t)(1 + p->arrays), LINE);
    c->searched = (uint64_t)(uintptr_t)scratch->data;
    c->status = c->searched + used;
    used += whole(4 * c->count, LINE);
    for (int i = 0; i < p->arrays; ++i) {
        c->tiles[i] = c->searched + used;
        used += whole(whole(c->count, TILE) * p->sizes[i] * item, LINE);
    }
    if ((scratch->rank != 1) || ((uint64_t)scratch->dims[0] < used)) { return refused(frame, XLA_FFI_Error_Code_INTERNAL, "eomgen: too little scratch memory"); }
    return NULL;
}

/* Put what is read into tiles, or what is written out of them. */
static int transposed(call *c, int is_back)
{
    const int first = (is_back != 0) ? c->p->arrays - 1 : 0;
    const int count = (is_back != 0) ? 1 : c->p->arrays - 1;
    uint64_t widest = 0;
    void *arguments[1 + 2*MOST] = { &c->count };
    for (int i = 0; i < count; ++i) {
        const uint64_t size = c->p->sizes[first + i];
        widest = (size > widest) ? size : widest;
        arguments[1 + i] = (is_back != 0) ? &c->tiles[first + i] : &c->rows[first + i];
        arguments[1 + count + i] = (is_back != 0) ? &c->rows[first + i] : &c->tiles[first + i];
    }
    return launched(c, (is_back != 0) ? c->p->end : c->p->begin, c->count * widest, arguments);
}

/* Put the search for a status that is not 0, and for what is not finite, on the stream. */
static int searched(call *c)
{
    void *arguments[3 + MOST] = { &c->count };
    const int code = c->p->calls->fill(c->searched, WELL, (size_t)(1 + c->p->arrays), c->stream);
    for (int i = 0; i < c->p->arrays; ++i) { arguments[1 + i] = &c->tiles[i]; }
    arguments[1 + c->p->arrays] = &c->status;
    arguments[2 + c->p->arrays] = &c->searched;
    return (code != 0) ? code : launched(c, c->p->find, c->count, arguments);
}

/* Wait, and say which state is not well. */
static XLA_FFI_Error *checked(call *c)
{
    const plan *const p = c->p;
    uint32_t found[1 + MOST];
    uint32_t status = 0;
    char text[TEXT];
    int code = p->calls->to_host(found, c->searched, sizeof found[0] * (size_t)(1 + p->arrays), c->stream);
    if (code == 0) { code = p->calls->wait(c->stream); }
    if ((code == 0) && (found[0] != WELL)) {
        code = p->calls->to_host(&status, c->status + 4 * (uint64_t)found[0], sizeof status, c->stream);
        if (code == 0) { code = p->calls->wait(c->stream); }
    }
    if (code != 0) { return failure(c, "a check", code); }
    for (int i = 0; i + 1 < p->arrays; ++i) {
        if (found[1 + i] != WELL) {
            (void)snprintf(text, sizeof text, "%s: %s in state %u is not finite; numbers must be finite", p->name, p->labels[i], (unsigned int)found[1 + i]);
            return refused(c->frame, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
        }
    }
    if (found[0] != WELL) {
        int end = snprintf(text, sizeof text, "%s in state %u:", p->name, (unsigned int)found[0]);
        for (int bit = 0; bit < STATUS_BITS; ++bit) {
            if (((status >> bit) & 1u) != 0u && (end >= 0) && (end < TEXT)) { end += snprintf(&text[end], (size_t)(TEXT - end), " %s;", p->reasons[bit]); }
        }
        return refused(c->frame, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
    }
    if (found[p->arrays] != WELL) {
        (void)snprintf(text, sizeof text, "%s: the result of state %u is not finite, out of numbers that are", p->name, (unsigned int)found[p->arrays]);
        return refused(c->frame, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
    }
    return NULL;
}

/* Put all of a call on its stream. */
static XLA_FFI_Error *run(call *c)
{
    const plan *const p = c->p;
    uint64_t h = p->h;
    void *arguments[3 + MOST] = { &c->count, &h };
    int code = 0;
    for (int i = 0; i < p->arrays; ++i) { arguments[2 + i] = &c->tiles[i]; }
    arguments[2 + p->arrays] = &c->status;
    code = transposed(c, 0);
    for (int i = 0; (i < p->parts) && (code == 0); ++i) { code = launched(c, p->functions[i], c->count, arguments); }
    if (code == 0) { code = transposed(c, 1); }
    if ((code == 0) && (p->checks != 0)) { code = searched(c); }
    if (code != 0) { return failure(c, "a launch", code); }
    return (p->checks != 0) ? checked(c) : NULL;
}

XLA_FFI_Error *eomgen_launch(XLA_FFI_CallFrame *frame)
{
    call c;
    void *before = NULL;
    XLA_FFI_Error *error = NULL;
    if (is_question(frame) != 0) { return NULL; }
    (void)memset(&c, 0, sizeof c);
    c.frame = frame;
    c.p = plan_of(frame);
    if (c.p == NULL) { return refused(frame, XLA_FFI_Error_Code_NOT_FOUND, "eomgen: a compiled function of another process; allowed: functions that eomgen.adapters.jax.function made in this one"); }
#ifndef EOM_NO_STREAM /* which tests on processors define */
    XLA_FFI_Stream_Get_Args asked = { XLA_FFI_Stream_Get_Args_STRUCT_SIZE, NULL, frame->ctx, NULL };
    error = frame->api->XLA_FFI_Stream_Get(&asked);
    if (error != NULL) { return error; }
    c.stream = asked.stream;
#endif
    const int code = c.p->calls->push(c.p->context);
    if (code != 0) { return failure(&c, "its context", code); }
    error = taken(&c);
    if ((error == NULL) && (c.count > 0)) { error = run(&c); }
    (void)c.p->calls->pop(&before);
    return error;
}

XLA_FFI_Error *eomgen_refuse(XLA_FFI_CallFrame *frame)
{
    char text[TEXT];
    const plan *p;
    if (is_question(frame) != 0) { return NULL; }
    p = plan_of(frame);
    (void)snprintf(text, sizeof text, "%s: arrays lie on the processor; allowed: arrays on %s", (p != NULL) ? p->name : "eomgen", (p != NULL) ? p->device : "a device");
    return refused(frame, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
}
