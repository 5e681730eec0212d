/* What the references share: the clock, the policy of the loop, a line or a socket. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static void sleep_until(int64_t ns)
{
    struct timespec t = { ns / 1000000000LL, ns % 1000000000LL };
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) != 0) {
    }
}

/* As realtime.py: what may not be had is done without. */
static void be_on_time(int priority)
{
    struct sched_param p = { .sched_priority = priority };
    if (sched_setscheduler(0, SCHED_FIFO, &p) != 0) {
        prctl(PR_SET_TIMERSLACK, 1UL);
    }
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
        return;
    }
}

/* "udp:PORT": a socket that speaks to 127.0.0.1:PORT; otherwise a serial device. */
static int open_link(const char *link)
{
    if (strncmp(link, "udp:", 4) == 0) {
        struct sockaddr_in to = { .sin_family = AF_INET, .sin_port = htons(atoi(link + 4)) };
        inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
        int fd = socket(AF_INET, SOCK_DGRAM, 0);
        if (fd < 0 || connect(fd, (struct sockaddr *)&to, sizeof to) != 0) {
            perror(link);
            exit(2);
        }
        return fd;
    }
    int fd = open(link, O_RDWR | O_NOCTTY);
    struct termios t;
    if (fd < 0 || tcgetattr(fd, &t) != 0) {
        perror(link);
        exit(2);
    }
    cfmakeraw(&t);
    cfsetspeed(&t, B921600);
    tcsetattr(fd, TCSANOW, &t);
    return fd;
}
