/* A file system that fails: of the calls of one kind that concern files below a folder, every
 * N-th fails with EIO. Preloaded into a program, before its C library:
 *
 *   FAILING_FOLDER   the folder
 *   FAILING_CALL     open, write or fsync
 *   FAILING_EVERY    N
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static atomic_int made;

/* Whether a call on a path is to fail. */
static int fails(const char *call, const char *path) {
    const char *folder = getenv("FAILING_FOLDER"), *kind = getenv("FAILING_CALL"), *every = getenv("FAILING_EVERY");
    if (!folder || !kind || !every || strcmp(kind, call) || strncmp(path, folder, strlen(folder))) return 0;
    if ((atomic_fetch_add(&made, 1) + 1) % atoi(every)) return 0;
    errno = EIO;
    return 1;
}

/* The same for an open file. */
static int fails_at(const char *call, int file) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return fails(call, path);
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

int open64(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    if ((flags & O_CREAT) && fails("open", path)) return -1;
    return NEXT(open64)(path, flags, mode);
}

ssize_t write(int file, const void *bytes, size_t count) {
    return fails_at("write", file) ? -1 : NEXT(write)(file, bytes, count);
}

int fsync(int file) { return fails_at("fsync", file) ? -1 : NEXT(fsync)(file); }
