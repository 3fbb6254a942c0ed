/* Stands before the C library's calls that change files, and lets the n-th of them fail.

   Loaded with LD_PRELOAD by tools/crash_test.py, so that what native code writes counts, too. It acts once it was armed
   with a folder: only paths below that folder count. A call that dies in a write has written half of it. A process that
   is started with FAULTS_FOLDER, FAULTS_HOW and FAULTS_AT in its environment is armed from its beginning. */
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
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { OFF, COUNT, KILL, FULL };
enum { FREE, ROOM };  /* whether a call needs room on the disk */

static char folder[4096];
static size_t folder_length;
static int mode = OFF;
static atomic_long count, room, target;

void faults_arm(const char *path, int how, long at) {
    snprintf(folder, sizeof folder, "%s", path);
    folder_length = strlen(folder);
    count = room = 0;
    target = at;
    mode = how;
}

__attribute__((constructor)) static void arm_early(void) {
    const char *path = getenv("FAULTS_FOLDER"), *how = getenv("FAULTS_HOW"), *at = getenv("FAULTS_AT");
    if (path && how && at) faults_arm(path, atoi(how), atol(at));
}

long faults_count(int needs_room) { return needs_room ? room : count; }

static int below(const char *path) {
    return !strncmp(path, folder, folder_length) && (path[folder_length] == '/' || !path[folder_length]);
}

static int below_fd(int fd) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return below(path);
}

static int below_at(int at, const char *path) {
    if (mode == OFF || !path) return 0;
    if (path[0] == '/') return below(path);
    if (at != AT_FDCWD) return below_fd(at);
    char here[4096], whole[8300];
    if (!getcwd(here, sizeof here)) return 0;
    snprintf(whole, sizeof whole, "%s/%s", here, path);
    return below(whole);
}

/* 1: this call is the one, or comes after it on a full disk. */
static int due(int needs_room) {
    long all = ++count, with_room = needs_room ? ++room : room;
    if (mode == KILL) return all == target;
    return mode == FULL && needs_room && with_room >= target;
}

static int fails(int needs_room) {
    if (!due(needs_room)) return 0;
    if (mode == KILL) kill(getpid(), SIGKILL);
    errno = ENOSPC;
    return 1;
}

#define REAL(name) static __typeof__(name) *real; if (!real) real = dlsym(RTLD_NEXT, #name)

#define OPEN(name)                                                                              \
    int name(const char *path, int flags, ...) {                                                \
        REAL(name);                                                                             \
        va_list rest; va_start(rest, flags); mode_t rights = va_arg(rest, mode_t); va_end(rest); \
        if ((flags & (O_WRONLY | O_RDWR | O_CREAT)) && below_at(AT_FDCWD, path) &&              \
            fails(flags & O_CREAT ? ROOM : FREE)) return -1;                                    \
        return real(path, flags, rights);                                                       \
    }
OPEN(open)
OPEN(open64)

#define OPENAT(name)                                                                            \
    int name(int at, const char *path, int flags, ...) {                                        \
        REAL(name);                                                                             \
        va_list rest; va_start(rest, flags); mode_t rights = va_arg(rest, mode_t); va_end(rest); \
        if ((flags & (O_WRONLY | O_RDWR | O_CREAT)) && below_at(at, path) &&                    \
            fails(flags & O_CREAT ? ROOM : FREE)) return -1;                                    \
        return real(at, path, flags, rights);                                                   \
    }
OPENAT(openat)
OPENAT(openat64)

#define FOPEN(name)                                                                             \
    FILE *name(const char *path, const char *how) {                                             \
        REAL(name);                                                                             \
        if (strpbrk(how, "wa+") && below_at(AT_FDCWD, path) && fails(ROOM)) return NULL;        \
        return real(path, how);                                                                 \
    }
FOPEN(fopen)
FOPEN(fopen64)

#define ONE_PATH(name, needs)                                                                   \
    int name(const char *path) {                                                                \
        REAL(name);                                                                             \
        return below_at(AT_FDCWD, path) && fails(needs) ? -1 : real(path);                      \
    }
ONE_PATH(unlink, FREE)
ONE_PATH(rmdir, FREE)
ONE_PATH(remove, FREE)

int unlinkat(int at, const char *path, int flags) {
    REAL(unlinkat);
    return below_at(at, path) && fails(FREE) ? -1 : real(at, path, flags);
}
int mkdir(const char *path, mode_t rights) {
    REAL(mkdir);
    return below_at(AT_FDCWD, path) && fails(ROOM) ? -1 : real(path, rights);
}
int mkdirat(int at, const char *path, mode_t rights) {
    REAL(mkdirat);
    return below_at(at, path) && fails(ROOM) ? -1 : real(at, path, rights);
}
int rename(const char *old, const char *new) {
    REAL(rename);
    return (below_at(AT_FDCWD, old) || below_at(AT_FDCWD, new)) && fails(FREE) ? -1 : real(old, new);
}
int renameat(int from, const char *old, int to, const char *new) {
    REAL(renameat);
    return (below_at(from, old) || below_at(to, new)) && fails(FREE) ? -1 : real(from, old, to, new);
}
int link(const char *old, const char *new) {
    REAL(link);
    return below_at(AT_FDCWD, new) && fails(ROOM) ? -1 : real(old, new);
}
int linkat(int from, const char *old, int to, const char *new, int flags) {
    REAL(linkat);
    return below_at(to, new) && fails(ROOM) ? -1 : real(from, old, to, new, flags);
}
int symlink(const char *old, const char *new) {
    REAL(symlink);
    return below_at(AT_FDCWD, new) && fails(ROOM) ? -1 : real(old, new);
}
int symlinkat(const char *old, int to, const char *new) {
    REAL(symlinkat);
    return below_at(to, new) && fails(ROOM) ? -1 : real(old, to, new);
}

#define TRUNCATED(name, size)                                                                   \
    int name(int fd, size length) {                                                             \
        REAL(name);                                                                             \
        return mode != OFF && below_fd(fd) && fails(FREE) ? -1 : real(fd, length);              \
    }
TRUNCATED(ftruncate, off_t)
TRUNCATED(ftruncate64, off64_t)

int fsync(int fd) {
    REAL(fsync);
    return mode != OFF && below_fd(fd) && fails(FREE) ? -1 : real(fd);
}
int fdatasync(int fd) {
    REAL(fdatasync);
    return mode != OFF && below_fd(fd) && fails(FREE) ? -1 : real(fd);
}

/* A write is cut in half: by the kill, or as the last that the disk had room for. */
ssize_t write(int fd, const void *data, size_t size) {
    REAL(write);
    if (mode == OFF || fd < 3 || !below_fd(fd) || !due(ROOM)) return real(fd, data, size);
    ssize_t half = room == target || mode == KILL ? real(fd, data, size / 2) : 0;
    if (mode == KILL) kill(getpid(), SIGKILL);
    if (half > 0) return half;
    errno = ENOSPC;
    return -1;
}
ssize_t writev(int fd, const struct iovec *parts, int amount) {
    REAL(writev);
    return mode != OFF && fd > 2 && below_fd(fd) && fails(ROOM) ? -1 : real(fd, parts, amount);
}

#define PWRITE(name, size)                                                                      \
    ssize_t name(int fd, const void *data, size_t length, size at) {                            \
        REAL(name);                                                                             \
        return mode != OFF && below_fd(fd) && fails(ROOM) ? -1 : real(fd, data, length, at);    \
    }
PWRITE(pwrite, off_t)
PWRITE(pwrite64, off64_t)

#define SENDFILE(name, size)                                                                    \
    ssize_t name(int out, int in, size *at, size_t length) {                                    \
        REAL(name);                                                                             \
        return mode != OFF && below_fd(out) && fails(ROOM) ? -1 : real(out, in, at, length);    \
    }
SENDFILE(sendfile, off_t)
SENDFILE(sendfile64, off64_t)

ssize_t copy_file_range(int in, off64_t *from, int out, off64_t *to, size_t length, unsigned flags) {
    REAL(copy_file_range);
    return mode != OFF && below_fd(out) && fails(ROOM) ? -1 : real(in, from, out, to, length, flags);
}
