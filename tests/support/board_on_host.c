/* A computer in place of a board; LAW is the file of the law.   board udp PORT | board serial LINK (a pseudo terminal) */
#define _GNU_SOURCE
#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include LAW

static int serial(const char *link)
{
    struct termios raw;
    uint8_t byte;
    int port, board = posix_openpt(O_RDWR | O_NOCTTY);
    if (board < 0 || grantpt(board) || unlockpt(board)) return 1;
    port = open(ptsname(board), O_RDWR | O_NOCTTY); /* stays open: this end works without anybody at the other */
    tcgetattr(port, &raw);
    cfmakeraw(&raw);
    tcsetattr(port, TCSANOW, &raw);
    unlink(link);
    if (symlink(ptsname(board), link)) return 1;
    puts("ready");
    fflush(stdout);
    while (read(board, &byte, 1) == 1) {
        int n = rig_byte(byte);
        if (n && write(board, rig_out, n) != n) return 1;
    }
    return 1;
}

static int udp(int number)
{
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons(number)}, who;
    socklen_t size = sizeof who;
    uint8_t frame[2048], *answer;
    int link = socket(AF_INET, SOCK_DGRAM, 0);
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (bind(link, (void *)&here, sizeof here)) return 1;
    puts("ready");
    fflush(stdout);
    for (;;) {
        int n = recvfrom(link, frame, sizeof frame, 0, (void *)&who, &size);
        if (n > 0 && (n = rig_answer(frame, n, &answer))) sendto(link, answer, n, 0, (void *)&who, size);
    }
}

int main(int n, char **given)
{
    if (n != 3) return 2;
    return strcmp(given[1], "udp") ? serial(given[2]) : udp(atoi(given[2]));
}
