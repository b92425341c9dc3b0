/* Prints the velocities of a rig as they are measured, from UDP datagrams:
 *
 *     cc -std=c11 -I include examples/listen.c -o listen
 *     ./listen 5005
 *
 * with udp = "127.0.0.1:5005" in [serve] of the rig file. Each line has the frame, the normal and the tangential velocity,
 * m/s, and the spin, rad/s. It ends when nothing arrives for three seconds. The computer has its lowest byte first.
 */
#define _POSIX_C_SOURCE 200809L
#include "ricochet.h"

#include <arpa/inet.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/time.h>

static int is_known(const ricochet_velocity_datagram_t *row, unsigned bit) {
    return row->known >> bit & 1;
}

static void set_timeout(int receiver, int seconds) {
    struct timeval timeout = {.tv_sec = seconds};
    setsockopt(receiver, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
}

int main(int count, char **arguments) {
    int receiver = socket(AF_INET, SOCK_DGRAM, 0);
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_ANY)};
    address.sin_port = htons((uint16_t)(count > 1 ? atoi(arguments[1]) : 5005));
    if (receiver < 0 || bind(receiver, (struct sockaddr *)&address, sizeof address) != 0) {
        perror("cannot receive at this port");
        return 1;
    }
    fprintf(stderr, "listening\n");
    set_timeout(receiver, 60);
    uint64_t next = 0, lost = 0, received = 0;
    ricochet_velocity_datagram_t row;
    while (recv(receiver, &row, sizeof row, 0) == (ssize_t)sizeof row && row.version == 1) {
        set_timeout(receiver, 3);
        if (received++ > 0 && row.number > next) {
            lost += row.number - next;
        }
        next = row.number + 1;
        if (is_known(&row, RICOCHET_DATAGRAM_BIT_VN_M_S) && is_known(&row, RICOCHET_DATAGRAM_BIT_OMEGA_RAD_S)) {
            printf("%" PRIu64 " %.17g %.17g %.17g\n", row.sequence, row.vn_m_s, row.vt_m_s, row.omega_rad_s);
        }
    }
    fprintf(stderr, "%" PRIu64 " received, %" PRIu64 " lost on the way\n", received, lost);
    return 0;
}
