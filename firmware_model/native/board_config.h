/* The scenario's numbers for its boards; firmware with numbers of its own ignores them. */
#ifndef BOARD_CONFIG_H
#define BOARD_CONFIG_H

#include <stdbool.h>
#include <stdint.h>

#define MU_VERSION 1 /* rises with a change of a frame, but not with a further number below, which the size of HELLO shows */

/* A whole board's, in the order of HELLO: milliseconds, but the bound of the drift, in 1e-9. 0 in the worst case. A program
 * that was built with other numbers does not begin. */
#define MU_WHOLE_NUMBERS(X) \
    X(chatter_ms)      /* a pin that bounces so long has the level that it held most of the time */ \
    X(check_ms)        /* the pin's level is read at whole multiples of this */                     \
    X(processing_ms)   /* the Pi works on samples so long; 0: no Pi */                              \
    X(listen_ms)       /* awake so long after it came to rest on the bottom */                      \
    X(report_ms)       /* awake in a dock so long after a report */                                 \
    X(transmit_ms)     /* a call of the last resort lasts so long */                               \
    X(call_ms)         /* between two calls of the last resort */                                   \
    X(hover_ms)        /* between two runs of the motors that hold a depth */                       \
    X(stay_down_ms)    /* no last resort so long after an order to sink */                          \
    X(turnaround_ms)   /* from a ping's end to the answer */                                        \
    X(answer_ms)       /* the modem transmits an answer so long */                                  \
    X(drift_bound_ppb) /* the clock errs by at most this; 0: it is trusted */                       \
    X(beacon_wait_ms)  /* listens so long for a beacon when the clock may err too much */
#define MU_MEMBER(name) uint32_t name;

enum mu_last_resort { MU_STAYS, MU_CALLS, MU_SURFACES };

struct mu_config {
    uint16_t id;
    uint32_t seed;                 /* of the board's own random numbers */
    uint32_t debounce_ms;          /* the charger's pin counts when its level stands so long */
    uint32_t boot_ms;              /* from power to the first decision */
    uint32_t surfacing_timeout_ms; /* the motors run up at most so long */
    uint32_t float_timeout_ms;     /* at the surface it waits so long for the aPad, and sinks */
    uint32_t release_wait_ms;      /* after a dock it waits so long before it sinks */
    MU_WHOLE_NUMBERS(MU_MEMBER)
    uint16_t kept_on;    /* rails that nothing switches off, as bits; this and the rest are a whole board's, too */
    bool sleeps;         /* else it stays awake */
    bool doubts_clock;   /* by drift_bound_ppb */
    bool uses_secondary; /* it works on the secondary battery, too */
    uint8_t last_resort; /* enum mu_last_resort: with both batteries low */
    uint8_t modem;       /* 2 or 3, the nanomodem's generation */
};

#endif
