/* SPDX-License-Identifier: Apache-2.0 */
/* Signals that ask for a statement, and those that end the process. A thread of the layer does the work: a handler may call next to
 * nothing, and what it interrupted may hold any lock. */
#include "layer/layer.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define CRASH_WAIT_MILLISECONDS 1000

static const int crash_signals[] = {SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT};

static pthread_mutex_t watch_lock = PTHREAD_MUTEX_INITIALIZER;
static int asked[2] = {-1, -1}, answered[2]; /* pipes; made once, used until the end of the process */
static pid_t owner;                          /* a child of fork has the handlers, but not the thread */
static int watched_signal;
static bool crashes_watched;

static void on_request(int signal)
{
    int kept = errno;
    unsigned char byte = (unsigned char)signal;
    if (getpid() == owner && write(asked[1], &byte, 1) < 0)
        errno = kept; /* the pipe is full: a statement is under way */
    errno = kept;
}

static void on_crash(int signal_number)
{
    unsigned char byte = (unsigned char)signal_number;
    struct pollfd answer = {.fd = answered[0], .events = POLLIN};
    if (getpid() == owner && write(asked[1], &byte, 1) == 1)
        poll(&answer, 1, CRASH_WAIT_MILLISECONDS);
    /* As if nobody had handled it. */
    signal(signal_number, SIG_DFL);
    raise(signal_number);
}

static bool is_crash(int number)
{
    for (size_t i = 0; i < sizeof crash_signals / sizeof crash_signals[0]; i++)
        if (crash_signals[i] == number)
            return true;
    return false;
}

static void *answer_requests(void *unused)
{
    unsigned char number;
    (void)unused;
    for (;;) {
        ssize_t got = read(asked[0], &number, 1);
        if (got < 0 && errno == EINTR)
            continue;
        if (got != 1)
            return NULL;
        if (!is_crash(number)) {
            gn_instances_state("asked for by a signal, the process goes on");
            continue;
        }
        char ending[96];
        const char *name = sigabbrev_np(number);
        snprintf(ending, sizeof ending, "the process died of SIG%s", name ? name : "?");
        gn_instances_close(ending);
        if (write(answered[1], &number, 1) != 1)
            return NULL;
    }
}

static bool start(void)
{
    sigset_t all, kept;
    pthread_t thread;
    if (asked[0] >= 0)
        return true;
    if (pipe2(asked, O_CLOEXEC) != 0)
        return false;
    if (pipe2(answered, O_CLOEXEC) != 0)
        goto fail;
    fcntl(asked[1], F_SETFL, O_NONBLOCK);
    owner = getpid();
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &kept);
    int failed = pthread_create(&thread, NULL, answer_requests, NULL);
    pthread_sigmask(SIG_SETMASK, &kept, NULL);
    if (!failed) {
        pthread_detach(thread);
        return true;
    }
    close(answered[0]);
    close(answered[1]);
fail:
    close(asked[0]);
    close(asked[1]);
    asked[0] = -1;
    return false;
}

/* Only where the application has no handler of its own; one that it installs later takes the place of ours. */
static bool handle(int number, void (*handler)(int))
{
    struct sigaction old, new = {.sa_handler = handler, .sa_flags = SA_RESTART | SA_ONSTACK};
    sigfillset(&new.sa_mask);
    if (sigaction(number, NULL, &old) != 0 || (old.sa_flags & SA_SIGINFO) || (old.sa_handler != SIG_DFL && old.sa_handler != SIG_IGN))
        return false;
    return sigaction(number, &new, NULL) == 0;
}

bool gn_signals_watch(const struct gn_settings *settings)
{
    bool good = true;
    if (!settings->statement_signal && !settings->crash_statement)
        return true;
    pthread_mutex_lock(&watch_lock);
    if (start()) {
        if (settings->statement_signal && settings->statement_signal != watched_signal) {
            good = handle(settings->statement_signal, on_request);
            if (good)
                watched_signal = settings->statement_signal;
        }
        for (size_t i = 0; settings->crash_statement && !crashes_watched && i < sizeof crash_signals / sizeof crash_signals[0]; i++)
            handle(crash_signals[i], on_crash);
        crashes_watched |= settings->crash_statement;
    }
    pthread_mutex_unlock(&watch_lock);
    return good;
}
