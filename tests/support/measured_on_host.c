/* A computer in place of a board that measures two values each millisecond: t in s, and -1 / t.
   measured udp PORT | measured serial LINK (a pseudo terminal) */
#define _GNU_SOURCE
#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "rig_board.h"

int main(int n, char **given)
{
    struct sockaddr_in here = {.sin_family = AF_INET}, rig = here;
    int udp = n == 3 && !strcmp(given[1], "udp");
    int link = udp ? socket(AF_INET, SOCK_DGRAM, 0) : posix_openpt(O_RDWR | O_NOCTTY);
    if (n != 3 || link < 0) return 2;
    if (udp) {
        here.sin_addr.s_addr = rig.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        here.sin_port = htons(atoi(given[2]));
        rig.sin_port = htons(atoi(given[2]) + 1);
        if (bind(link, (void *)&here, sizeof here)) return 1;
    } else {
        struct termios raw;
        int port;
        if (grantpt(link) || unlockpt(link)) return 1;
        port = open(ptsname(link), O_RDWR | O_NOCTTY); /* stays open: this end works without anybody at the other */
        tcgetattr(port, &raw);
        cfmakeraw(&raw);
        tcsetattr(port, TCSANOW, &raw);
        fcntl(link, F_SETFL, O_NONBLOCK);
        if (symlink(ptsname(link), given[2])) return 1;
    }
    puts("ready");
    fflush(stdout);
    for (int64_t k = 1;; k++) {
        double values[2] = {1e-3 * k, -1e3 / k};
        int size = rig_measured(1000000 * k, values, 2);
        if (udp) sendto(link, rig_last, RIG_HEAD + sizeof values, 0, (void *)&rig, sizeof rig);
        else if (write(link, rig_out, size) != size) continue; /* nobody reads */
        usleep(1000);
    }
}
