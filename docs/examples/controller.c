/* A joint controller at 1 kHz without ROS: gravity, friction and inverse dynamics.
 *
 *   dynid export out/kuka_lwr4plus --format c
 *   cc -O2 -DMODEL='"out/kuka_lwr4plus/kuka_lwr4plus.c"' docs/examples/controller.c -o controller -lm && ./controller
 *
 * In place of the loop's first lines stands what reads your drives; it prints the time that a step takes.
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include MODEL

#define STEPS 20000

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(void)
{
    const double dt = 1e-3, stiffness = 100.0, damping = 20.0;
    double q[DYNID_N] = {0}, qd[DYNID_N], goal[DYNID_N], command[DYNID_N], friction[DYNID_N], gravity[DYNID_N];
    double started, spent = 0.0;
    int i, k;
    for (k = 0; k < STEPS; k++) {
        for (i = 0; i < DYNID_N; i++) {
            q[i] = 0.3 * sin(2.0 * k * dt);
            qd[i] = 0.6 * cos(2.0 * k * dt);
        }
        started = now();
        for (i = 0; i < DYNID_N; i++) goal[i] = -1.2 * sin(2.0 * k * dt) + stiffness * (0.0 - q[i]) - damping * qd[i];
        dynid_inverse_dynamics(q, qd, goal, command);
        dynid_gravity(q, gravity);
        dynid_friction(qd, friction);
        spent += now() - started;
    }
    printf("%.1f us a step: inverse dynamics, gravity, friction\n", 1e6 * spent / STEPS);
    return 0;
}
