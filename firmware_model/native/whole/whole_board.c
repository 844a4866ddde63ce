/* The whole board: its tasks, in the order in which they get an event. */
#include "board.h"

/* The clock and the log are ready before the state machine begins. */
static void boot(const struct hal_event *event) {
    if (event->kind == HAL_RESET) {
        clock_start();
        log_open();
    }
    pin_event(event);
}

static const struct hal_task ALL[TASKS] = {
    [PIN_TASK] = {boot, pin_timer},
    [STATE_TASK] = {state_event, state_timer},
    [ANSWER_TASK] = {report_event, answer_timer},
    [COMMAND_TASK] = {command_event, NULL},
};

int main(void) {
    hal_run(ALL, TASKS);
    return 0;
}
