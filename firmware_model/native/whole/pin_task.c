/* The task of the charger's pin: an edge counts once its level has stayed; a pin that bounces on is decided by the greater
 * part of the time; an edge whose interrupt was lost is found at a check. */
#include "board.h"

static struct {
    bool seen, high, settling;
    uint64_t flipped, unsettled, counted, high_ms, check;
} pin;

bool pin_is_high(void) { return pin.high; }

static uint64_t due(void) {
    const struct mu_config *config = hal_config();
    uint64_t settled = pin.flipped + config->debounce_ms, chatters = pin.unsettled + config->chatter_ms;
    return settled < chatters ? settled : chatters;
}

static void wait(void) {
    hal_timer(PIN_TASK, pin.settling && due() < pin.check ? due() : pin.check);
}

static void count(void) {
    pin.high_ms += pin.seen ? hal_now() - pin.counted : 0;
    pin.counted = hal_now();
}

/* Reads the level; true if it differs from the one last seen. */
static bool sample(void) {
    bool level = hal_charger();
    if (level == pin.seen)
        return false;
    if (!pin.settling) {
        pin.unsettled = pin.counted = hal_now();
        pin.high_ms = 0;
    }
    count();
    pin.seen = level;
    pin.flipped = hal_now();
    pin.settling = true;
    wait();
    return true;
}

void pin_check(void) {
    if (sample())
        hal_refuse("an edge of the charger's pin was missed: its level told");
}

static void certain(bool high) {
    if (high == pin.high)
        return;
    pin.high = high;
    if (board.state == OFF || board.state == BOOTING)
        return; /* the level is read again after the boot */
    if (high) {
        board.last_resort = HAL_NEVER;
        board.clear_to_sink = false;
        apply(CHARGE_EDGE_ROSE);
        return;
    }
    apply(CHARGE_EDGE_FELL);
    if (board.clear_to_sink && board.state == RELEASED)
        apply(CLEAR_TO_SINK);
}

static void settle(void) {
    if (hal_now() >= pin.flipped + hal_config()->debounce_ms) {
        pin.settling = false;
        certain(pin.seen);
        return;
    }
    hal_refuse("the charger's pin chatters: the greater part of the time decided");
    count();
    int64_t more_high = (int64_t)(2 * pin.high_ms) - (int64_t)(hal_now() - pin.unsettled);
    pin.unsettled = hal_now();
    pin.high_ms = 0;
    certain(more_high ? more_high > 0 : pin.high);
}

void pin_timer(void) {
    uint64_t now = hal_now();
    bool missed = sample();
    if (missed)
        hal_refuse("an edge of the charger's pin was missed: its level told");
    if (now >= pin.check)
        pin.check += hal_config()->check_ms;
    if (!missed && pin.settling && now >= due())
        settle();
    wait();
}

void pin_event(const struct hal_event *event) {
    if (event->kind == HAL_RESET) {
        uint64_t check_ms = hal_config()->check_ms;
        pin.seen = pin.high = hal_charger();
        pin.check = (hal_now() / check_ms + 1) * check_ms;
        wait();
    } else if (event->kind == HAL_CHARGER) {
        sample();
    }
}
