/* The board of the paper's worst case (section IV-A) in C: it never sleeps, and has one battery and one load.
 *
 * It decides as firmware_model/base_firmware.py does; docs/firmware-states.md has its states. */
#include "musselbed.h"

#include <stdio.h>
#include <string.h>

#define COUNT(table) (sizeof(table) / sizeof *(table))
#define CHATTER_MS 2000
#define CHECK_TICKS (60u * MU_HZ) /* the pin's level is read at whole multiples of a minute */

enum state { OFF, BOOTING, ACTIVE, SURFACING, FLOATING, CHARGING, RELEASED, SINKING, EMPTY };

static const char *const STATES[] = {"OFF",      "BOOTING",  "ACTIVE",  "SURFACING", "FLOATING",
                                     "CHARGING", "RELEASED", "SINKING", "EMPTY"};

enum trigger {
    POWER_CAME_ON,
    BOOTED_ON_BOTTOM,
    BOOTED_AT_SURFACE,
    BOOTED_ON_CHARGER,
    PERMISSION_HEARD,
    SURFACE_REACHED,
    CHARGE_EDGE_ROSE,
    CHARGE_EDGE_FELL,
    CLEAR_TO_SINK,
    FLOAT_TIMED_OUT,
    BOTTOM_REACHED,
    BATTERY_EMPTIED,
    PING_HEARD,
    SINK_ORDERED,
    SURFACING_TIMED_OUT
};

static const char *const TRIGGERS[] = {
    "POWER_CAME_ON",    "BOOTED_ON_BOTTOM", "BOOTED_AT_SURFACE", "BOOTED_ON_CHARGER", "PERMISSION_HEARD",
    "SURFACE_REACHED",  "CHARGE_EDGE_ROSE", "CHARGE_EDGE_FELL",  "CLEAR_TO_SINK",     "FLOAT_TIMED_OUT",
    "BOTTOM_REACHED",   "BATTERY_EMPTIED",  "PING_HEARD",        "SINK_ORDERED",         "SURFACING_TIMED_OUT"};

#define IN(state) (1u << (state))
#define STAYS 0xFF

/* A trigger, the states that take it, and where it leads. */
static const struct {
    enum trigger on;
    unsigned from;
    uint8_t to;
} TABLE[] = {
    {POWER_CAME_ON, IN(OFF), BOOTING},
    {BOOTED_ON_BOTTOM, IN(BOOTING), ACTIVE},
    {BOOTED_AT_SURFACE, IN(BOOTING), FLOATING},
    {BOOTED_ON_CHARGER, IN(BOOTING), CHARGING},
    {PING_HEARD, IN(ACTIVE) | IN(EMPTY) | IN(SURFACING) | IN(SINKING), STAYS},
    {PERMISSION_HEARD, IN(ACTIVE) | IN(EMPTY) | IN(SINKING), SURFACING},
    {SURFACE_REACHED, IN(ACTIVE) | IN(EMPTY) | IN(SURFACING) | IN(SINKING), FLOATING},
    {CHARGE_EDGE_ROSE, IN(ACTIVE) | IN(EMPTY) | IN(SURFACING) | IN(FLOATING) | IN(RELEASED) | IN(SINKING), CHARGING},
    {CHARGE_EDGE_FELL, IN(CHARGING), RELEASED},
    {CLEAR_TO_SINK, IN(FLOATING) | IN(RELEASED), SINKING},
    {FLOAT_TIMED_OUT, IN(FLOATING), SINKING},
    {SINK_ORDERED, IN(SURFACING) | IN(FLOATING) | IN(RELEASED), SINKING},
    {SURFACING_TIMED_OUT, IN(SURFACING), SINKING},
    {BOTTOM_REACHED, IN(RELEASED) | IN(SINKING), ACTIVE},
    {BATTERY_EMPTIED, IN(ACTIVE), EMPTY},
};

static struct {
    enum state state;
    bool clear_to_sink;
    bool has_deadline;
    uint32_t deadline; /* the state ends by itself */
    enum trigger ends_by;
} board;

/* The charger's pin: the level last seen, the debounced one, and the time of an uncertain level. */
static struct {
    bool seen, high, settling;
    uint32_t flipped, unsettled, counted, high_ticks;
} pin;

static uint32_t next_check;

static void apply(enum trigger trigger);

/* Reads the pin's level; true if it differs from the one last seen. */
static bool sample_pin(void) {
    bool level = mu_level(MU_CHARGER);
    uint32_t now = mu_now();
    if (level == pin.seen)
        return false;
    if (!pin.settling) {
        pin.unsettled = pin.counted = now;
        pin.high_ticks = 0;
    }
    pin.high_ticks += pin.seen ? now - pin.counted : 0;
    pin.counted = now;
    pin.seen = level;
    pin.flipped = now;
    pin.settling = true;
    return true;
}

/* Finds an edge whose interrupt was lost. */
static bool check_pin(void) {
    bool missed = sample_pin();
    if (missed)
        mu_refuse("an edge of the charger's pin was missed: its level told");
    return missed;
}

static uint32_t pin_due(void) {
    uint32_t settled = pin.flipped + mu_ticks(mu_config()->debounce_ms), chatters = pin.unsettled + mu_ticks(CHATTER_MS);
    return (int32_t)(settled - chatters) < 0 ? settled : chatters;
}

static void pin_certain(bool high) {
    if (high == pin.high)
        return;
    pin.high = high;
    if (board.state == OFF || board.state == BOOTING)
        return; /* the level is read again after the boot */
    if (high) {
        board.clear_to_sink = false;
        apply(CHARGE_EDGE_ROSE);
        return;
    }
    apply(CHARGE_EDGE_FELL);
    if (board.clear_to_sink && board.state == RELEASED)
        apply(CLEAR_TO_SINK);
}

static void pin_settles(void) {
    uint32_t now = mu_now();
    if (check_pin())
        return;
    if (mu_reached(pin.flipped + mu_ticks(mu_config()->debounce_ms))) {
        pin.settling = false;
        pin_certain(pin.seen);
        return;
    }
    /* It bounces for longer than any edge does: the level of the greater part of the time counts. */
    mu_refuse("the charger's pin chatters: the greater part of the time decided");
    pin.high_ticks += pin.seen ? now - pin.counted : 0;
    pin.counted = now;
    int32_t more_high = (int32_t)(2 * pin.high_ticks - (now - pin.unsettled));
    pin.unsettled = now;
    pin.high_ticks = 0;
    pin_certain(more_high ? more_high > 0 : pin.high);
}

static void ends_after(uint32_t ms, enum trigger by) {
    board.has_deadline = true;
    board.deadline = mu_now() + mu_ticks(ms);
    board.ends_by = by;
}

static void run_motors(enum mu_output way) {
    mu_pin(way, true);
    mu_pin(way, false); /* the driver ends a run by itself */
}

static void enter(void) {
    const struct mu_config *config = mu_config();
    board.has_deadline = false;
    if (board.state == SURFACING)
        run_motors(MU_MOTOR_UP);
    if (board.state == SINKING)
        run_motors(MU_MOTOR_DOWN);
    if (board.state != BOOTING)
        mu_pin(MU_CHARGE, board.state == CHARGING);
    mu_pin(MU_WATCH_BATTERY, board.state == ACTIVE);
    if (board.state == BOOTING)
        ends_after(config->boot_ms, BOOTED_ON_BOTTOM);
    if (board.state == SURFACING)
        ends_after(config->surfacing_timeout_ms, SURFACING_TIMED_OUT);
    if (board.state == FLOATING)
        ends_after(config->float_timeout_ms, FLOAT_TIMED_OUT);
    if (board.state == RELEASED)
        ends_after(config->release_wait_ms, CLEAR_TO_SINK);
    if (board.state != CHARGING && board.state != EMPTY)
        check_pin();
}

static void apply(enum trigger trigger) {
    char text[64];
    for (size_t n = 0; n < COUNT(TABLE); n++)
        if (TABLE[n].on == trigger && TABLE[n].from & IN(board.state)) {
            if (TABLE[n].to == STAYS)
                return;
            board.state = (enum state)TABLE[n].to;
            mu_state((uint8_t)board.state);
            enter();
            return;
        }
    snprintf(text, sizeof text, "%s does not take %s", STATES[board.state], TRIGGERS[trigger]);
    mu_refuse(text);
}

static void state_ends(void) {
    enum trigger by = board.ends_by;
    board.has_deadline = false;
    if (board.state == BOOTING && pin.high)
        by = BOOTED_ON_CHARGER;
    else if (board.state == BOOTING && mu_level(MU_SURFACE))
        by = BOOTED_AT_SURFACE;
    if (by == SURFACING_TIMED_OUT)
        mu_refuse("a surfacing: it did not come up in time");
    apply(by);
}

/* The commands of docs/packets.md: version, kind, bytes, and what this board does with them. */
static const struct {
    uint8_t version, kind, size;
    const char *name;
    int trigger;
} COMMANDS[] = {
    {1, 2, 6, "PERMISSION", PERMISSION_HEARD}, {1, 3, 6, "RELEASE", CLEAR_TO_SINK}, {1, 4, 6, "PING", PING_HEARD},
    {1, 5, 6, "HOVER", -1},                    {2, 5, 7, "HOVER", -1},              {2, 6, 6, "SINK", SINK_ORDERED},
    {2, 7, 14, "SLEEP_SCHEDULE", -1},          {2, 8, 22, "SLOT_ASSIGNMENT", -1},   {2, 9, 9, "SET_THRESHOLD", -1},
    {2, 10, 6, "BACK_UP_LOG", -1},             {2, 11, 14, "BEACON", -1},           {2, 12, 10, "LOG_ACK", -1},
};

static void command(const uint8_t *data, size_t size) {
    char text[64];
    size_t n = 0;
    while (n < COUNT(COMMANDS) && (size != COMMANDS[n].size || data[0] != COMMANDS[n].version || data[1] != COMMANDS[n].kind))
        n++;
    if (n == COUNT(COMMANDS) || mu_crc(data, size - 2) != (data[size - 2] | data[size - 1] << 8)) {
        mu_refuse("not a command");
        return;
    }
    uint16_t id = (uint16_t)(data[2] | data[3] << 8);
    if (id && id != mu_config()->id) {
        mu_refuse("for another aMussel");
    } else if (COMMANDS[n].trigger < 0) {
        snprintf(text, sizeof text, "the worst case knows no %s", COMMANDS[n].name);
        mu_refuse(text);
    } else if (!id && COMMANDS[n].trigger == PING_HEARD) {
        mu_refuse("a ping for everyone: all would answer at once");
    } else if (COMMANDS[n].trigger == CLEAR_TO_SINK && board.state == CHARGING) {
        board.clear_to_sink = true; /* the packet may come before the falling edge is certain */
    } else {
        apply((enum trigger)COMMANDS[n].trigger);
    }
}

static void alarm_rang(void) {
    if (mu_reached(next_check)) {
        next_check += CHECK_TICKS;
        check_pin();
    }
    if (pin.settling && mu_reached(pin_due()))
        pin_settles();
    if (board.has_deadline && mu_reached(board.deadline))
        state_ends();
}

static uint32_t next_alarm(void) {
    uint32_t at = next_check;
    if (pin.settling && (int32_t)(pin_due() - at) < 0)
        at = pin_due();
    if (board.has_deadline && (int32_t)(board.deadline - at) < 0)
        at = board.deadline;
    return at;
}

int main(void) {
    struct mu_event event;
    if (!mu_open("worst-case"))
        return 2;
    while (mu_wait(&event)) {
        if (event.kind == MU_RESET) {
            next_check = (mu_now() / CHECK_TICKS + 1) * CHECK_TICKS;
            pin.seen = pin.high = mu_level(MU_CHARGER);
            apply(POWER_CAME_ON);
        } else if (event.kind == MU_ALARM) {
            alarm_rang();
        } else if (event.kind == MU_UART) {
            command(event.data, event.size);
        } else if (event.port == MU_CHARGER) {
            sample_pin();
        } else if (event.high) {
            apply(event.port == MU_SURFACE ? SURFACE_REACHED : event.port == MU_BOTTOM ? BOTTOM_REACHED : BATTERY_EMPTIED);
        }
        mu_alarm(next_alarm());
    }
    return 0;
}
