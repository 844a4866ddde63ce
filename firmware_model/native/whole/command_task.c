/* The task of the commands: docs/packets.md has their bytes. */
#include "board.h"

#include <stdio.h>

#define COUNT(table) (sizeof(table) / sizeof *(table))
#define LATEST_MS (UINT64_C(1) << 53) /* a beacon of a later time is nonsense */
#define HEAD 4

enum kind { PERMISSION = 2, RELEASE, PING, HOVER, SINK, SLEEP_SCHEDULE, SLOT_ASSIGNMENT, SET_THRESHOLD, BACK_UP_LOG, BEACON, LOG_ACK };

static const struct {
    uint8_t version, kind, size;
} COMMANDS[] = {{1, PERMISSION, 6},      {1, RELEASE, 6},          {1, PING, 6},          {1, HOVER, 6},   {2, HOVER, 7},
                {2, SINK, 6},            {2, SLEEP_SCHEDULE, 14},  {2, SLOT_ASSIGNMENT, 22}, {2, SET_THRESHOLD, 9},
                {2, BACK_UP_LOG, 6},     {2, BEACON, 14},          {2, LOG_ACK, 10}};

static bool is_command(const uint8_t *data, size_t size) {
    for (size_t n = 0; n < COUNT(COMMANDS); n++)
        if (size == COMMANDS[n].size && data[0] == COMMANDS[n].version && data[1] == COMMANDS[n].kind)
            return get_bytes(data + size - 2, 2) == hal_crc(data, size - 2) && !(data[1] == SET_THRESHOLD && data[HEAD] > 2);
    return false;
}

/* Applies what a schedule or a slot says; false for one that cannot be. */
static bool change_settings(enum kind kind, const uint8_t *arguments) {
    struct hal_settings changed = settings;
    if (kind == SLEEP_SCHEDULE) {
        changed.alarm_ms = (uint32_t)get_bytes(arguments, 4);
        changed.sample_ms = (uint32_t)get_bytes(arguments + 4, 4);
        if (!settings.alarm_ms || !changed.sample_ms || changed.sample_ms >= changed.alarm_ms)
            return false;
    } else {
        changed.frame_ms = (uint32_t)get_bytes(arguments, 4);
        changed.slot_ms = (uint32_t)get_bytes(arguments + 4, 4);
        changed.guard_ms = (uint32_t)get_bytes(arguments + 8, 2);
        changed.slot = (uint16_t)get_bytes(arguments + 10, 2);
        changed.offset_ms = (int32_t)get_bytes(arguments + 12, 4);
        if (!changed.slot_ms || (changed.slot + UINT64_C(1)) * changed.slot_ms > changed.frame_ms ||
            changed.guard_ms >= changed.slot_ms)
            return false;
    }
    settings = changed;
    settings_changed();
    return true;
}

static void renew_clock_deadline(void) {
    if (board.state == SLEEPING || board.state == CHARGING || board.state == AWAITING_SLOT)
        renew_deadline();
}

/* The log goes by Wi-Fi: a docked board stays awake for it. */
static bool extends_report(void) {
    bool has_wifi = hal_powered() >> HAL_WIFI & 1;
    if (!has_wifi)
        hal_refuse("Wi-Fi is off");
    else if (board.state == REPORTING)
        renew_deadline();
    return has_wifi;
}

static void execute_with_trigger(enum kind kind, enum trigger trigger, uint32_t depth_mm) {
    if (kind == RELEASE && (board.state == CHARGING || board.state == REPORTING)) {
        board.clear_to_sink = true; /* the packet may come before the falling edge is certain */
        return;
    }
    if (kind == HOVER && takes(board.state, trigger))
        board.commanded_mm = depth_mm;
    if (kind == SINK && takes(board.state, trigger))
        board.stays_down_until = hal_now() + hal_config()->stay_down_ms;
    apply(trigger);
}

static void execute(enum kind kind, const uint8_t *data) {
    const uint8_t *arguments = data + HEAD;
    uint32_t depth_mm = data[0] == 2 ? arguments[0] * 250u : HAL_HERE;
    switch (kind) {
    case BEACON:
        clock_set(get_bytes(arguments, 8));
        renew_clock_deadline();
        apply_if_allowed(BEACON_HEARD);
        break;
    case SLEEP_SCHEDULE:
    case SLOT_ASSIGNMENT:
        if (change_settings(kind, arguments))
            renew_clock_deadline();
        else
            hal_refuse(kind == SLEEP_SCHEDULE ? "a SLEEP_SCHEDULE that cannot be" : "a SLOT_ASSIGNMENT that cannot be");
        break;
    case SET_THRESHOLD:
        clock_pass_over();
        hal_set_level(arguments[0], (uint16_t)get_bytes(arguments + 1, 2));
        renew_clock_deadline();
        break;
    case LOG_ACK:
        if (extends_report() && !log_acknowledge((uint32_t)get_bytes(arguments, 4)))
            hal_refuse("an acknowledgement of records that were never taken");
        break;
    case BACK_UP_LOG:
        if (extends_report())
            log_upload();
        break;
    case PERMISSION: execute_with_trigger(kind, PERMISSION_HEARD, 0); break;
    case RELEASE: execute_with_trigger(kind, CLEAR_TO_SINK, 0); break;
    case PING: execute_with_trigger(kind, PING_HEARD, 0); break;
    case HOVER: execute_with_trigger(kind, HOVER_ORDERED, depth_mm); break;
    case SINK: execute_with_trigger(kind, SINK_ORDERED, 0); break;
    }
}

void command_event(const struct hal_event *event) {
    if (event->kind != HAL_PACKET)
        return;
    const uint8_t *data = event->data;
    if (!is_command(data, event->size)) {
        hal_refuse("not a command");
        return;
    }
    uint16_t id = (uint16_t)get_bytes(data + 2, 2);
    if (id && id != hal_config()->id)
        hal_refuse("for another aMussel");
    else if (!id && data[1] == PING)
        hal_refuse("a ping for everyone: all would answer at once");
    else if (data[1] == BEACON && get_bytes(data + HEAD, 8) > LATEST_MS)
        hal_refuse("a beacon of a time that cannot be");
    else if (data[1] == HOVER && data[0] == 2 && !data[HEAD])
        hal_refuse("a depth at the surface: it surfaces by permission only");
    else
        execute((enum kind)data[1], data);
}
