/* Faults for scripts/kills.py, preloaded into a program: cc -shared -fPIC -O1 faults.c -o faults.so -ldl
 *
 * A step is a call that changes a file below FAULT_UNDER or, with FAULT_FILE, a call that opens, examines or
 * reads that file. Steps are counted from 1, over all threads.
 *   FAULT_DIE=N      SIGKILL before step N
 *   FAULT_FULL=N     from step N on the disk is full: what needs room fails with ENOSPC
 *   FAULT_FILE=PATH, FAULT_NEXT=PATH, FAULT_STEP=N, FAULT_HOW=replace|rewrite
 *                    before step N the file gets the content of FAULT_NEXT: by a rename, or in place
 *   FAULT_CLOCK=1    the time of day jumps by a day, forward or back, ten times a second
 *   FAULT_COUNT=PATH the number of steps is written there at the end
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define FDS 4096
static atomic_long steps;
static atomic_int watched[FDS];
static const char *under, *file, *next_content, *how, *count_path;
static long die_at, full_at, change_at;
static int jumps;

#define REAL(name) \
    static __typeof__(name) *real; \
    if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

__attribute__((constructor)) static void begin(void) {
    const char *text;
    under = getenv("FAULT_UNDER");
    file = getenv("FAULT_FILE");
    next_content = getenv("FAULT_NEXT");
    how = getenv("FAULT_HOW");
    count_path = getenv("FAULT_COUNT");
    die_at = (text = getenv("FAULT_DIE")) ? atol(text) : 0;
    full_at = (text = getenv("FAULT_FULL")) ? atol(text) : 0;
    change_at = (text = getenv("FAULT_STEP")) ? atol(text) : 0;
    jumps = getenv("FAULT_CLOCK") != NULL;
}

__attribute__((destructor)) static void end(void) {
    if (!count_path || !steps) return;
    int fd = syscall(SYS_openat, AT_FDCWD, count_path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dprintf(fd, "%ld", (long)steps);
    syscall(SYS_close, fd);
}

/* The calls of the change itself are direct, so that they are no steps. */
static void change(void) {
    static char bytes[1 << 24];
    long size = 0, n;
    int from = syscall(SYS_openat, AT_FDCWD, next_content, O_RDONLY);
    while ((n = syscall(SYS_read, from, bytes + size, sizeof bytes - size)) > 0) size += n;
    syscall(SYS_close, from);
    if (!strcmp(how, "replace")) {
        char beside[4096];
        snprintf(beside, sizeof beside, "%s.next", file);
        int to = syscall(SYS_openat, AT_FDCWD, beside, O_WRONLY | O_CREAT | O_TRUNC, 0600);
        if (syscall(SYS_write, to, bytes, size) != size) _exit(99);
        syscall(SYS_close, to);
        syscall(SYS_renameat2, AT_FDCWD, beside, AT_FDCWD, file, 0);
        return;
    }
    int to = syscall(SYS_openat, AT_FDCWD, file, O_WRONLY);
    if (syscall(SYS_pwrite64, to, bytes, size, 0) != size || syscall(SYS_ftruncate, to, size)) _exit(99);
    syscall(SYS_close, to);
}

/* Counts a step. Returns whether the disk is full. */
static int step(void) {
    long at = atomic_fetch_add(&steps, 1) + 1;
    if (die_at && at == die_at) syscall(SYS_kill, getpid(), SIGKILL);
    if (change_at && at == change_at) change();
    return full_at && at >= full_at;
}

/* Whether a path is below FAULT_UNDER. A relative path is, where the folder is the current one. */
static int is_under(const char *path) {
    char here[4096];
    if (!under || !path) return 0;
    if (path[0] == '/') return !strncmp(path, under, strlen(under));
    return getcwd(here, sizeof here) && !strncmp(here, under, strlen(under));
}

static int is_file(const char *path) {
    const char *name = file ? strrchr(file, '/') + 1 : NULL;
    const char *base = path ? strrchr(path, '/') : NULL;
    return name && path && !strcmp(base ? base + 1 : path, name);
}

static int full(void) { errno = ENOSPC; return -1; }

static int opened(int fd, int is_watched) {
    if (fd >= 0 && fd < FDS) watched[fd] = is_watched;
    return fd;
}

#define OPENS(name, start, ...) \
    int name(start const char *path, int flags, ...) { \
        REAL(name); \
        va_list list; \
        va_start(list, flags); \
        int mode = va_arg(list, int); \
        va_end(list); \
        int writes = (flags & O_ACCMODE) != O_RDONLY && is_under(path), reads = is_file(path); \
        if ((writes || reads) && step() && (flags & O_CREAT)) return full(); \
        return opened(real(__VA_ARGS__ path, flags, mode), writes || reads); \
    }
#define FOLDER int at,
#define AT at,
OPENS(open, )
OPENS(open64, )
OPENS(openat, FOLDER, AT)
OPENS(openat64, FOLDER, AT)

ssize_t read(int fd, void *to, size_t size) {
    REAL(read);
    if (file && fd >= 0 && fd < FDS && watched[fd]) step();
    return real(fd, to, size);
}

ssize_t write(int fd, const void *from, size_t size) {
    REAL(write);
    if (!file && fd >= 0 && fd < FDS && watched[fd] && step()) return full();
    return real(fd, from, size);
}

int fsync(int fd) {
    REAL(fsync);
    if (!file && fd >= 0 && fd < FDS && watched[fd] && step()) return full();
    return real(fd);
}

int close(int fd) {
    REAL(close);
    if (fd >= 0 && fd < FDS) watched[fd] = 0;
    return real(fd);
}

int statx(int at, const char *restrict path, int flags, unsigned int mask, struct statx *restrict out) {
    REAL(statx);
    if (file && (is_file(path) || (!*path && at >= 0 && at < FDS && watched[at]))) step();
    return real(at, path, flags, mask, out);
}

int mkdir(const char *path, mode_t mode) {
    REAL(mkdir);
    return is_under(path) && step() ? full() : real(path, mode);
}

int link(const char *from, const char *to) {
    REAL(link);
    return is_under(to) && step() ? full() : real(from, to);
}

int linkat(int a, const char *from, int b, const char *to, int flags) {
    REAL(linkat);
    return is_under(to) && step() ? full() : real(a, from, b, to, flags);
}

int rename(const char *from, const char *to) {
    REAL(rename);
    if (is_under(to)) step();
    return real(from, to);
}

int unlink(const char *path) {
    REAL(unlink);
    if (is_under(path)) step();
    return real(path);
}

int rmdir(const char *path) {
    REAL(rmdir);
    if (is_under(path)) step();
    return real(path);
}

static long jump(void) {
    struct timespec now;
    syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now);
    return jumps ? (long[]){0, 86400, 0, -86400}[(now.tv_sec * 10 + now.tv_nsec / 100000000) % 4] : 0;
}

int clock_gettime(clockid_t clock, struct timespec *out) {
    int code = syscall(SYS_clock_gettime, clock, out);
    if (!code && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) out->tv_sec += jump();
    return code;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone) {
    (void)zone;
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    out->tv_sec = now.tv_sec;
    out->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *out) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (out) *out = now.tv_sec;
    return now.tv_sec;
}
