/* Lets calls on files below the folder CHAOS_FOLDER fail with EIO in the process that preloads this: so many of a thousand as
 * the file CHAOS_CALLS says, which may change at any time. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define REAL(name) __typeof__(name) *real = dlsym(RTLD_NEXT, #name)

static int64_t share(void) {
  static const int64_t none;
  static const volatile int64_t *shared;
  if (!shared) {
    REAL(open64);
    const char *path = getenv("CHAOS_CALLS");
    int file = path ? real(path, O_RDONLY | O_CLOEXEC) : -1;
    void *page = file < 0 ? MAP_FAILED : mmap(NULL, sizeof none, PROT_READ, MAP_SHARED, file, 0);
    if (file >= 0) close(file);
    shared = page == MAP_FAILED ? &none : page;
  }
  return *shared;
}

static int fails(const char *path) {
  const char *folder = getenv("CHAOS_FOLDER");
  if (!folder || !path || strncmp(path, folder, strlen(folder)) || random() % 1000 >= share()) return 0;
  errno = EIO;
  return 1;
}

static int fails_on(int file) {
  char link[32], path[4096];
  if (!share()) return 0;
  snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  ssize_t length = readlink(link, path, sizeof path - 1);
  if (length < 0) return 0;
  path[length] = 0;
  return fails(path);
}

int open64(const char *path, int flags, ...) {
  REAL(open64);
  va_list rest;
  va_start(rest, flags);
  mode_t mode = va_arg(rest, mode_t);
  va_end(rest);
  return share() && fails(path) ? -1 : real(path, flags, mode);
}

int rename(const char *before, const char *after) {
  REAL(rename);
  return share() && fails(after) ? -1 : real(before, after);
}

int link(const char *before, const char *after) {
  REAL(link);
  return share() && fails(after) ? -1 : real(before, after);
}

int linkat(int from, const char *before, int to, const char *after, int flags) {
  REAL(linkat);
  return share() && fails(after) ? -1 : real(from, before, to, after, flags);
}

ssize_t read(int file, void *bytes, size_t count) {
  REAL(read);
  return fails_on(file) ? -1 : real(file, bytes, count);
}

ssize_t write(int file, const void *bytes, size_t count) {
  REAL(write);
  return fails_on(file) ? -1 : real(file, bytes, count);
}

int fsync(int file) {
  REAL(fsync);
  return fails_on(file) ? -1 : real(file);
}
