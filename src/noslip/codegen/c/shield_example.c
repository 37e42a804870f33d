/* A hand draws a wave along x, its sensor off by up to half a millimeter; the tool follows as far as it
 * may.  Writes t,x,y,z,qw,qx,qy,qz,distance,angle to standard output: m and rad to the hand's command. */
#include "shield.h"

#include <math.h>
#include <stdio.h>

#define SECONDS 2.0
#define ROUND 6.283185307179586

int main(void) {
    static noslip_shield shield;
    const int steps = (int)(SECONDS / NOSLIP_SHIELD_PERIOD);
    unsigned noise = 1;
    double seen[7];
    int k, i;
    printf("t,x,y,z,qw,qx,qy,qz,distance,angle\n");
    for (k = 0; k <= steps; ++k) {
        const double t = SECONDS * (steps > 0 ? (double)k / (double)steps : 0), s = t / SECONDS;
        const double eased = s * s * s * (10 - s * (15 - 6 * s));
        const double turn = ROUND * eased;
        const double slope = 0.6 * cos(turn), yaw = atan(slope) / 2;
        double command[7] = {0, 0, 0, 0, 0, 0, 0};
        command[0] = 0.1 * eased;
        command[1] = 0.1 * 0.6 / ROUND * sin(turn);
        command[3] = cos(yaw);
        command[6] = sin(yaw);
        if (k == 0) noslip_shield_start(&shield, command);
        for (i = 0; i < 3; ++i) {
            noise = noise * 1664525u + 1013904223u;
            command[i] += 1e-3 * ((double)(noise >> 16 & 0xffffu) / 65536 - 0.5);
        }
        if (k % 10 == 0) {
            /* A camera sees where the tool was when it came. */
            for (i = 0; i < 3; ++i) seen[i] = shield.position[i];
            for (i = 0; i < 4; ++i) seen[3 + i] = shield.quaternion[i];
        }
        if (noslip_shield_step(&shield, command, k % 10 == 5 ? seen : 0)) return 1;
        printf("%.17g", shield.time);
        for (i = 0; i < 3; ++i) printf(",%.17g", shield.position[i]);
        for (i = 0; i < 4; ++i) printf(",%.17g", shield.quaternion[i]);
        printf(",%.6g,%.6g\n", noslip_shield_distance(&shield), noslip_shield_angle(&shield));
    }
    return 0;
}
