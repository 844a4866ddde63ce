#include "musselbed.h"

int main(void) {
    struct mu_event event;
    if (!mu_open("my board"))
        return 2;
    while (mu_wait(&event)) {          /* sleeps until something happens */
        if (event.kind == MU_RESET)
            mu_alarm(mu_now() + mu_ticks(2000));
        else if (event.kind == MU_ALARM)
            mu_state(2);               /* ACTIVE, for records and reports */
        else if (event.kind == MU_PIN && event.port == MU_CHARGER)
            mu_pin(MU_CHARGE, event.high);
    }
    return 0;
}
