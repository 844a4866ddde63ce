/* The task of the state machine: what is switched in a state, when it ends by itself, and what the batteries do to it. */
#include "board.h"

#include <stdio.h>

#define R(rail) (1u << (rail))
#define SENSORS (R(HAL_OXYGEN) | R(HAL_PRESSURE) | R(HAL_TEMPERATURE) | R(HAL_TURBIDITY))

struct board board = {.state = OFF, .commanded_mm = HAL_HERE, .last_resort = HAL_NEVER};

/* The trigger at the end of the state; by the board's timer or by the clock chip's alarm, or never. */
static enum trigger ends_by;
static bool by_timer, by_clock;

static const uint16_t RAILS[STATES] = {
    [BOOTING] = R(HAL_MODEM),       [ACTIVE] = R(HAL_MODEM),
    [SURFACING] = R(HAL_MODEM),     [FLOATING] = R(HAL_MODEM) | R(HAL_WIFI) | R(HAL_GSM) | R(HAL_BLUETOOTH),
    [CHARGING] = R(HAL_MODEM),      [RELEASED] = R(HAL_MODEM) | R(HAL_WIFI),
    [SINKING] = R(HAL_MODEM),       [EMPTY] = R(HAL_MODEM),
    [SLEEPING] = R(HAL_MODEM),      [SAMPLING] = R(HAL_MODEM) | SENSORS,
    [PROCESSING] = R(HAL_MODEM) | R(HAL_PI), [AWAITING_SLOT] = R(HAL_MODEM),
    [TRANSMITTING] = R(HAL_MODEM),  [HOVERING] = R(HAL_MODEM),
    [REPORTING] = R(HAL_MODEM) | SENSORS | R(HAL_WIFI), [CALLING] = R(HAL_MODEM),
    [AWAITING_BEACON] = R(HAL_MODEM)};

static enum hal_sleep sleep_in(enum state state) {
    bool asleep = state == SLEEPING || state == CHARGING || state == EMPTY;
    return asleep && hal_config()->sleeps ? HAL_DEEP : HAL_AWAKE;
}

static void ends_at(uint64_t at, enum trigger by) {
    ends_by = by;
    by_timer = true;
    hal_timer(STATE_TASK, at);
}

static void ends_after(uint64_t ms, enum trigger by) { ends_at(hal_now() + ms, by); }

static void ends_at_reading(uint64_t reading, enum trigger by) {
    ends_by = by;
    by_clock = true;
    hal_clock_alarm(reading);
}

static void last_resort_deadline(void) {
    const struct mu_config *config = hal_config();
    uint64_t at = hal_now();
    if (config->last_resort == MU_STAYS || !hal_at_safe_level())
        return;
    if (board.last_resort != HAL_NEVER && board.last_resort + config->call_ms > at)
        at = board.last_resort + config->call_ms;
    if (config->last_resort == MU_CALLS)
        ends_at(at, LAST_RESORT_CALL);
    else
        ends_at(at > board.stays_down_until ? at : board.stays_down_until, LAST_RESORT_SURFACE);
}

static void slot_deadline(void) {
    bool doubted;
    uint64_t reading = clock_slot(&doubted);
    if (doubted)
        ends_after(0, CLOCK_DOUBTED);
    else
        ends_at_reading(reading, SLOT_OPENED);
}

static void sleep_cycle_deadline(void) {
    const struct mu_config *config = hal_config();
    switch (board.state) {
    case ACTIVE: ends_after(config->listen_ms, WAKE_OVER); break;
    case SLEEPING:
    case CHARGING: ends_at_reading(clock_next_alarm(), ALARM_RANG); break;
    case SAMPLING: ends_after(settings.sample_ms, WAKE_OVER); break;
    case REPORTING: ends_after(config->report_ms, WAKE_OVER); break;
    case PROCESSING: ends_after(config->processing_ms, WAKE_OVER); break;
    case AWAITING_SLOT: slot_deadline(); break;
    case AWAITING_BEACON: ends_after(config->beacon_wait_ms, WAKE_OVER); break;
    default: break;
    }
}

/* On its primary, or on a secondary that is in use and above the reserve for a last resort. */
static bool can_work(void) {
    const struct mu_config *config = hal_config();
    bool has_reserve = config->last_resort != MU_STAYS && hal_at_safe_level();
    return hal_feed() == HAL_PRIMARY || (config->uses_secondary && !has_reserve);
}

void renew_deadline(void) {
    const struct mu_config *config = hal_config();
    if (by_clock)
        hal_clock_alarm(HAL_NEVER);
    by_timer = by_clock = false;
    hal_timer(STATE_TASK, HAL_NEVER);
    switch (board.state) {
    case BOOTING: ends_after(config->boot_ms, BOOTED_ON_BOTTOM); break;
    case SURFACING: ends_after(config->surfacing_timeout_ms, SURFACING_TIMED_OUT); break;
    case FLOATING: /* after a last resort to the surface it does not sink again by itself */
        if (board.last_resort == HAL_NEVER)
            ends_after(config->float_timeout_ms, FLOAT_TIMED_OUT);
        break;
    case RELEASED: ends_after(config->release_wait_ms, CLEAR_TO_SINK); break;
    case HOVERING: ends_after(config->hover_ms, HOVER_DUE); break;
    case TRANSMITTING:
    case CALLING: ends_after(config->transmit_ms, WAKE_OVER); break;
    case EMPTY: last_resort_deadline(); break;
    default:
        if (board.state == ACTIVE && !can_work())
            ends_after(0, BATTERY_EMPTIED);
        else if (config->sleeps)
            sleep_cycle_deadline();
    }
}

/* Motors, switches, the deadline and the report of the state just entered. */
static void enter(void) {
    enum state state = board.state;
    if (state == SURFACING)
        hal_motors(HAL_FLOAT, 0);
    else if (state == SINKING)
        hal_motors(HAL_SINK, 0);
    else if (state == HOVERING)
        hal_motors(HAL_HOVER, board.commanded_mm);
    clock_pass_over();
    hal_rails(RAILS[state], sleep_in(state));
    renew_deadline();
    if (state == TRANSMITTING || state == CALLING)
        report_by_sound();
    if (state == REPORTING) {
        report_by_wifi();
        log_upload();
    }
    if (state != SLEEPING && state != CHARGING && state != EMPTY)
        pin_check();
}

void apply(enum trigger trigger) {
    enum state next = next_state(board.state, trigger);
    if (next == STATES) {
        char text[64];
        snprintf(text, sizeof text, "%s does not take %s", STATE_NAMES[board.state], TRIGGER_NAMES[trigger]);
        hal_refuse(text);
    } else if (trigger == PING_HEARD) {
        ping_heard();
    } else {
        board.state = next;
        hal_tell_state((uint8_t)next);
        enter();
    }
}

void apply_if_allowed(enum trigger trigger) {
    if (takes(board.state, trigger))
        apply(trigger);
}

/* The trigger at the end of SAMPLING or PROCESSING, by the settings of that moment. */
static enum trigger after_work(void) {
    if (board.state == SAMPLING && hal_config()->processing_ms)
        return SAMPLES_TO_PROCESS;
    if (!settings.frame_ms)
        return WAKE_OVER;
    return board.state == SAMPLING ? SAMPLES_TO_SEND : PROCESSED;
}

static void state_ends(void) {
    enum trigger trigger = ends_by;
    by_timer = by_clock = false;
    if (trigger == SURFACING_TIMED_OUT)
        hal_refuse("a surfacing: it did not come up in time");
    if (board.state == BOOTING)
        trigger = pin_is_high() ? BOOTED_ON_CHARGER : hal_at_surface() ? BOOTED_AT_SURFACE : BOOTED_ON_BOTTOM;
    if (trigger == WAKE_OVER && (board.state == SAMPLING || board.state == PROCESSING))
        trigger = after_work();
    if (board.state == SAMPLING)
        log_sample();
    if (board.state == AWAITING_BEACON)
        hal_refuse("a status: no beacon came, and the clock may be off by more than the guard");
    if (trigger == ALARM_RANG)
        clock_rang();
    if (trigger == LAST_RESORT_CALL || trigger == LAST_RESORT_SURFACE)
        board.last_resort = hal_now();
    apply(trigger);
}

void state_timer(void) {
    bool is_last_resort = by_timer && (ends_by == LAST_RESORT_CALL || ends_by == LAST_RESORT_SURFACE);
    if (is_last_resort && !hal_at_safe_level())
        by_timer = false; /* a charger was there for a moment */
    else if (by_timer)
        state_ends();
}

void state_event(const struct hal_event *event) {
    switch (event->kind) {
    case HAL_RESET:
        board.reset_cause = event->cause;
        apply(POWER_CAME_ON);
        break;
    case HAL_CHARGER:
        if (board.state == EMPTY)
            renew_deadline();
        break;
    case HAL_SURFACE: apply(SURFACE_REACHED); break;
    case HAL_BOTTOM: apply(BOTTOM_REACHED); break;
    case HAL_CLOCK:
        if (by_clock)
            state_ends();
        break;
    case HAL_EMPTIED:
        if (!can_work())
            apply_if_allowed(BATTERY_EMPTIED);
        break;
    case HAL_SAFE_LEVEL:
        if (board.state == EMPTY)
            renew_deadline();
        else if (!can_work())
            apply_if_allowed(BATTERY_EMPTIED);
        break;
    case HAL_LOW_LEVEL: apply_if_allowed(LOW_LEVEL_REACHED); break;
    default: break;
    }
}
