/* FMI 3.0 co-simulation around an exported device. Before it stand NAME_state, NAME_reset, NAME_read,
   NAME_step, the constants STATES, CONSTANTS, SETTINGS, PERIOD, TOKEN and their tables. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "fmi3Functions.h"

/* Value references: time, command, reading, force sent; then states, constants, settings. */
enum { TIME, COMMAND, MEASURED, DRIVE, FIRST_STATE,
       FIRST_CONSTANT = FIRST_STATE + STATES, FIRST_SETTING = FIRST_CONSTANT + CONSTANTS,
       END = FIRST_SETTING + SETTINGS };

typedef struct {
    NAME_state device;
    double time, command;
} zwidth_memory;

typedef struct {
    zwidth_memory now;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback say;
    fmi3Boolean talks;
} zwidth_instance;

#define NOW (&((zwidth_instance *)instance)->now)

static fmi3Status wrong(fmi3Instance instance, const char *why)
{
    zwidth_instance *it = (zwidth_instance *)instance;
    if (it && it->say) it->say(it->environment, fmi3Error, "logStatusError", why);
    return fmi3Error;
}

static void start(zwidth_memory *now)
{
    NAME_reset(&now->device);
    now->time = 0.0;
    now->command = 0.0;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n,
                               const fmi3String categories[])
{
    (void)n; (void)categories;
    ((zwidth_instance *)instance)->talks = on;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean talks, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference needed[],
    size_t n, fmi3InstanceEnvironment environment, fmi3LogMessageCallback say,
    fmi3IntermediateUpdateCallback update)
{
    zwidth_instance *made = NULL;
    (void)name; (void)resources; (void)visible; (void)events; (void)early; (void)needed; (void)n;
    (void)update;
    if (!token || strcmp(token, TOKEN) != 0) {
        if (say) say(environment, fmi3Error, "logStatusError",
                     "the instantiation token is that of another FMU");
        return NULL;
    }
    made = (zwidth_instance *)calloc(1, sizeof *made);
    if (!made) return NULL;
    made->environment = environment;
    made->say = say;
    made->talks = talks;
    start(&made->now);
    return made;
}

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d, fmi3Boolean e,
    fmi3InstanceEnvironment f, fmi3LogMessageCallback g)
{
    (void)a; (void)b; (void)c; (void)d; (void)e; (void)f; (void)g;
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d, fmi3Boolean e,
    fmi3InstanceEnvironment f, fmi3LogMessageCallback g, fmi3ClockUpdateCallback h,
    fmi3LockPreemptionCallback i, fmi3UnlockPreemptionCallback j)
{
    (void)a; (void)b; (void)c; (void)d; (void)e; (void)f; (void)g; (void)h; (void)i; (void)j;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerant,
                                       fmi3Float64 tolerance, fmi3Float64 from,
                                       fmi3Boolean ends, fmi3Float64 to)
{
    (void)tolerant; (void)tolerance; (void)ends; (void)to;
    NOW->time = from;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { (void)instance; return fmi3OK; }
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { (void)instance; return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance instance) { (void)instance; return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance instance) { start(NOW); return fmi3OK; }

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference at[], size_t n,
                          fmi3Float64 values[], size_t m)
{
    const zwidth_memory *now = NOW;
    if (n != m) return wrong(instance, "every variable of this FMU is one number");
    for (size_t i = 0; i < n; i++) {
        const fmi3ValueReference k = at[i];
        if (k == TIME) values[i] = now->time;
        else if (k == COMMAND) values[i] = now->command;
        else if (k == MEASURED) values[i] = NAME_read(&now->device);
        else if (k == DRIVE) values[i] = now->device.command;
        else if (k < FIRST_CONSTANT) values[i] = now->device.x[k - FIRST_STATE];
        else if (k < FIRST_SETTING) values[i] = zwidth_constants[k - FIRST_CONSTANT];
        else if (k < END) values[i] = now->device.p[k - FIRST_SETTING];
        else return wrong(instance, "there is no variable of this value reference");
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference at[], size_t n,
                          const fmi3Float64 values[], size_t m)
{
    zwidth_memory *now = NOW;
    if (n != m) return wrong(instance, "every variable of this FMU is one number");
    for (size_t i = 0; i < n; i++) {
        if (at[i] == COMMAND) {
            now->command = values[i];
        } else if (at[i] >= FIRST_SETTING && at[i] < END) {
            const size_t k = at[i] - FIRST_SETTING;
            if (!(zwidth_lower[k] <= values[i] && values[i] <= zwidth_upper[k]))
                return wrong(instance, "a parameter is outside its bounds (min and max)");
            now->device.p[k] = values[i];
        } else {
            return wrong(instance, "only the command and the parameters may be set");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 from, fmi3Float64 length,
                      fmi3Boolean final, fmi3Boolean *events, fmi3Boolean *ends,
                      fmi3Boolean *early, fmi3Float64 *reached)
{
    zwidth_memory *now = NOW;
    const double ticks = floor(length / PERIOD + 0.5);
    (void)final;
    if (events) *events = fmi3False;
    if (ends) *ends = fmi3False;
    if (early) *early = fmi3False;
    if (!(ticks >= 1.0 && fabs(length / PERIOD - ticks) < 1e-6 * ticks)) {
        char why[120];
        if (reached) *reached = from;
        snprintf(why, sizeof why, "a step of %.9g s is no multiple of the sampling period, %.9g s",
                 length, PERIOD);
        return wrong(instance, why);
    }
    for (double k = 0.0; k < ticks; k += 1.0) (void)NAME_step(&now->device, now->command);
    now->time = from + length;
    if (reached) *reached = now->time;
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *kept)
{
    if (!*kept) *kept = malloc(sizeof(zwidth_memory));
    if (!*kept) return wrong(instance, "there is no memory left");
    memcpy(*kept, NOW, sizeof(zwidth_memory));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState kept)
{
    memcpy(NOW, kept, sizeof(zwidth_memory));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *kept)
{
    (void)instance;
    free(*kept);
    *kept = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState kept, size_t *size)
{
    (void)instance; (void)kept;
    *size = sizeof(zwidth_memory);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState kept, fmi3Byte bytes[],
                                 size_t size)
{
    if (size != sizeof(zwidth_memory)) return wrong(instance, "the size is not that of a state");
    memcpy(bytes, kept, size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *kept)
{
    if (size != sizeof(zwidth_memory)) return wrong(instance, "the size is not that of a state");
    if (!*kept) *kept = malloc(size);
    if (!*kept) return wrong(instance, "there is no memory left");
    memcpy(*kept, bytes, size);
    return fmi3OK;
}

/* What FMI asks for and this device has nothing of. */
#define NOTHING(name, ...)                                                     \
    fmi3Status name(fmi3Instance instance, __VA_ARGS__)                        \
    { return wrong(instance, #name ": this FMU has nothing of the kind"); }
#define NO_TYPE(type)                                                                              \
    NOTHING(fmi3Get##type, const fmi3ValueReference a[], size_t n, fmi3##type v[], size_t m)       \
    NOTHING(fmi3Set##type, const fmi3ValueReference a[], size_t n, const fmi3##type v[], size_t m)
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(Int32)
NO_TYPE(UInt32)
NO_TYPE(Int64)
NO_TYPE(UInt64)
NO_TYPE(Boolean)
NO_TYPE(String)
NOTHING(fmi3GetBinary, const fmi3ValueReference a[], size_t n, size_t s[], fmi3Binary v[], size_t m)
NOTHING(fmi3SetBinary, const fmi3ValueReference a[], size_t n, const size_t s[],
        const fmi3Binary v[], size_t m)
NOTHING(fmi3GetClock, const fmi3ValueReference a[], size_t n, fmi3Clock v[])
NOTHING(fmi3SetClock, const fmi3ValueReference a[], size_t n, const fmi3Clock v[])
NOTHING(fmi3GetNumberOfVariableDependencies, fmi3ValueReference a, size_t *n)
NOTHING(fmi3GetVariableDependencies, fmi3ValueReference a, size_t b[], fmi3ValueReference c[],
        size_t d[], fmi3DependencyKind e[], size_t n)
NOTHING(fmi3GetDirectionalDerivative, const fmi3ValueReference a[], size_t n,
        const fmi3ValueReference b[], size_t m, const fmi3Float64 c[], size_t k, fmi3Float64 d[],
        size_t l)
NOTHING(fmi3GetAdjointDerivative, const fmi3ValueReference a[], size_t n,
        const fmi3ValueReference b[], size_t m, const fmi3Float64 c[], size_t k, fmi3Float64 d[],
        size_t l)
NOTHING(fmi3GetIntervalDecimal, const fmi3ValueReference a[], size_t n, fmi3Float64 b[],
        fmi3IntervalQualifier c[])
NOTHING(fmi3GetIntervalFraction, const fmi3ValueReference a[], size_t n, fmi3UInt64 b[],
        fmi3UInt64 c[], fmi3IntervalQualifier d[])
NOTHING(fmi3GetShiftDecimal, const fmi3ValueReference a[], size_t n, fmi3Float64 b[])
NOTHING(fmi3GetShiftFraction, const fmi3ValueReference a[], size_t n, fmi3UInt64 b[],
        fmi3UInt64 c[])
NOTHING(fmi3SetIntervalDecimal, const fmi3ValueReference a[], size_t n, const fmi3Float64 b[])
NOTHING(fmi3SetIntervalFraction, const fmi3ValueReference a[], size_t n, const fmi3UInt64 b[],
        const fmi3UInt64 c[])
NOTHING(fmi3SetShiftDecimal, const fmi3ValueReference a[], size_t n, const fmi3Float64 b[])
NOTHING(fmi3SetShiftFraction, const fmi3ValueReference a[], size_t n, const fmi3UInt64 b[],
        const fmi3UInt64 c[])
NOTHING(fmi3UpdateDiscreteStates, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *c, fmi3Boolean *d,
        fmi3Boolean *e, fmi3Float64 *f)
NOTHING(fmi3CompletedIntegratorStep, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *c)
NOTHING(fmi3SetTime, fmi3Float64 a)
NOTHING(fmi3SetContinuousStates, const fmi3Float64 a[], size_t n)
NOTHING(fmi3GetContinuousStateDerivatives, fmi3Float64 a[], size_t n)
NOTHING(fmi3GetEventIndicators, fmi3Float64 a[], size_t n)
NOTHING(fmi3GetContinuousStates, fmi3Float64 a[], size_t n)
NOTHING(fmi3GetNominalsOfContinuousStates, fmi3Float64 a[], size_t n)
NOTHING(fmi3GetNumberOfEventIndicators, size_t *n)
NOTHING(fmi3GetNumberOfContinuousStates, size_t *n)
NOTHING(fmi3GetOutputDerivatives, const fmi3ValueReference a[], size_t n, const fmi3Int32 b[],
        fmi3Float64 c[], size_t m)
NOTHING(fmi3ActivateModelPartition, fmi3ValueReference a, fmi3Float64 b)

#define NOTHING_AT_ALL(name)                                                                       \
    fmi3Status name(fmi3Instance instance)                                                         \
    { return wrong(instance, #name ": this FMU has nothing of the kind"); }
NOTHING_AT_ALL(fmi3EnterEventMode)
NOTHING_AT_ALL(fmi3EnterContinuousTimeMode)
NOTHING_AT_ALL(fmi3EnterConfigurationMode)
NOTHING_AT_ALL(fmi3ExitConfigurationMode)
NOTHING_AT_ALL(fmi3EvaluateDiscreteStates)
