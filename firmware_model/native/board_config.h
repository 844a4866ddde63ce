/* The scenario's numbers for its boards; firmware with numbers of its own ignores them. */
#ifndef BOARD_CONFIG_H
#define BOARD_CONFIG_H

#include <stdbool.h>
#include <stdint.h>

/* A whole board's, in the order of HELLO: milliseconds, but the bound of the drift, in 1e-9. 0 in the worst case. */
#define MU_WHOLE_NUMBERS(X) \
    X(chatter_ms) \
    X(check_ms) \
    X(processing_ms) \
    X(listen_ms) \
    X(report_ms) \
    X(transmit_ms) \
    X(call_ms) \
    X(hover_ms) \
    X(stay_down_ms) \
    X(turnaround_ms) \
    X(answer_ms) \
    X(drift_bound_ppb) \
    X(beacon_wait_ms)
#define MU_MEMBER(name) uint32_t name;

enum mu_last_resort { MU_STAYS, MU_CALLS, MU_SURFACES };

struct mu_config {
    uint16_t id;
    uint32_t seed, debounce_ms, boot_ms, surfacing_timeout_ms, float_timeout_ms, release_wait_ms;
    MU_WHOLE_NUMBERS(MU_MEMBER)
    uint16_t kept_on; /* this and the rest are a whole board's, too */
    bool sleeps, doubts_clock, uses_secondary;
    uint8_t last_resort, modem; /* 2 or 3, the nanomodem's generation */
};

#endif
