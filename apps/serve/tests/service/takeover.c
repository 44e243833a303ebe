/* Stands for a vlscan that a file has taken over: tries to read, write, connect, signal and outlive whatever the sandbox should keep
   from it, and writes a line for each attempt, which begins with BREACH if it succeeded. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/ipc.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/shm.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <sys/xattr.h>
#include <unistd.h>

extern char **environ;
static FILE *out;

static void attempt(const char *name, const char *what, int is_breach) {
  int error = errno;
  fprintf(out, "%s %s %s (%s)\n", is_breach ? "BREACH" : "held", name, what, is_breach ? "done" : strerror(error));
  fflush(out);
}

static void reads(const char *path) {
  int file = open(path, O_RDONLY);
  attempt("read", path, file >= 0);
  if (file >= 0) close(file);
}

static void writes(const char *path) {
  int file = open(path, O_WRONLY | O_CREAT | O_APPEND, 0644);
  attempt("write", path, file >= 0);
  if (file >= 0) close(file);
}

static void changes(const char *path) {
  struct timeval times[2] = {{1, 0}, {1, 0}};
  struct timespec exact[2] = {{1, 0}, {1, 0}};
  int file = open(path, O_RDONLY), flags = 0x40;
  attempt("chmod", path, chmod(path, 0777) == 0);
  attempt("fchmodat", path, fchmodat(AT_FDCWD, path, 0777, 0) == 0);
  attempt("fchmodat2", path, syscall(452, AT_FDCWD, path, 0777, 0) == 0);
  attempt("chown", path, chown(path, getuid(), getgid()) == 0);
  attempt("lchown", path, lchown(path, getuid(), getgid()) == 0);
  attempt("utimes", path, utimes(path, times) == 0);
  attempt("utimensat", path, utimensat(AT_FDCWD, path, exact, 0) == 0);
  attempt("setxattr", path, setxattr(path, "user.a", "b", 1, 0) == 0);
  attempt("truncate", path, truncate(path, 1) == 0);
  if (file < 0) return;
  attempt("fchmod", path, fchmod(file, 0777) == 0);
  attempt("fchown", path, fchown(file, getuid(), getgid()) == 0);
  attempt("futimens", path, futimens(file, exact) == 0);
  attempt("fsetxattr", path, fsetxattr(file, "user.a", "b", 1, 0) == 0);
  attempt("flags", path, ioctl(file, 0x40086602, &flags) == 0);
  attempt("lease", path, fcntl(file, F_SETLEASE, F_WRLCK) == 0);
  attempt("owner", path, fcntl(file, F_SETOWN, getppid()) == 0);
  close(file);
}

static void sees(const char *path, const char *absent) {
  struct stat about;
  int first = stat(path, &about) ? errno : 0, second = stat(absent, &about) ? errno : 0;
  errno = first;
  attempt("stat", path, HAS_ROOT && first != second);
  first = access(path, F_OK) ? errno : 0;
  errno = first;
  attempt("access", path, HAS_ROOT && first != second);
  first = open(path, O_RDONLY) < 0 ? errno : 0;
  errno = first;
  attempt("open", path, HAS_ROOT && first != second);
}

static void connects(void) {
  struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(PORT)};
  struct sockaddr_un name = {.sun_family = AF_UNIX};
  int pair[2], made = socket(AF_INET, SOCK_STREAM, 0);
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  attempt("tcp", "", connect(made, (void *)&address, sizeof address) == 0);
  made = socket(AF_INET, SOCK_DGRAM, 0);
  attempt("udp", "", sendto(made, "x", 1, 0, (void *)&address, sizeof address) > 0);
  made = socket(AF_UNIX, SOCK_STREAM, 0);
  attempt("unix socket", "", made >= 0);
  strcpy(name.sun_path, SOCKET);
  attempt("unix path", SOCKET, connect(made, (void *)&name, sizeof name) == 0);
  attempt("netlink", "", socket(AF_NETLINK, SOCK_RAW, 0) >= 0);
  attempt("vsock", "", socket(40, SOCK_STREAM, 0) >= 0);
  attempt("socketpair", "", socketpair(AF_UNIX, SOCK_STREAM, 0, pair) == 0);
  attempt("x32 socket", "", syscall(0x40000000 | SYS_socket, AF_UNIX, SOCK_STREAM, 0) >= 0);
  char parameters[256] = {0};
  attempt("io_uring", "", syscall(425, 4, parameters) >= 0);
  attempt("shared memory", "", shmget(IPC_PRIVATE, 4096, IPC_CREAT | 0600) >= 0);
  attempt("memfd", "", syscall(319, "x", 0) >= 0);
}

static int rests(void *nothing) {
  for (;;) pause();
}

static void multiplies(void) {
  char *words[] = {"sh", "-c", "true", NULL};
  unsigned long long arguments[11] = {0};
  pid_t child = fork();
  if (child == 0) for (;;) pause();
  attempt("fork", "", child > 0);
  child = syscall(SYS_vfork);
  if (child == 0) _exit(0);
  attempt("vfork", "", child > 0);
  child = syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0);
  if (child == 0) for (;;) pause();
  attempt("clone", "", child > 0);
  child = syscall(435, arguments, sizeof arguments);
  if (child == 0) for (;;) pause();
  attempt("clone3", "", child > 0);
  errno = posix_spawn(&child, "/bin/sh", NULL, NULL, words, environ);
  attempt("spawn", "", errno == 0);
  attempt("death signal", "", prctl(PR_SET_PDEATHSIG, 0) == 0);
  attempt("hidden files", "", prctl(PR_SET_DUMPABLE, 0) == 0);
  /* FALLOC_FL_KEEP_SIZE, and the same by FS_IOC_RESVSP64 and FS_IOC_ZERO_RANGE. */
  attempt("hidden space", "", fallocate(fileno(out), 1, 0, 1 << 20) == 0);
  struct { short type, whence; long long start, length; int system; unsigned process; int rest[4]; } space = {0, 0, 0, 1 << 20, 0, 0, {0}};
  attempt("hidden space", "by ioctl", ioctl(fileno(out), 0x4030582a, &space) == 0);
  attempt("hidden space", "of zeros", ioctl(fileno(out), 0x40305839, &space) == 0);
  /* Open files of a thread that no list of the process has. */
  static char stack[65536];
  int own_files = CLONE_VM | CLONE_FS | CLONE_SIGHAND | CLONE_THREAD | CLONE_SYSVSEM;
  attempt("hidden files", "of a thread", clone(rests, stack + sizeof stack, own_files, NULL) >= 0);
  attempt("hidden files", "by close_range", syscall(436, 1000, 1001, 2) == 0);
  /* Folders that their owner cannot list or remove. */
  attempt("closed folder", "", mkdir("../tmp/closed", 0) == 0);
  attempt("closed folder", "without reading", mkdirat(AT_FDCWD, "../tmp/blind", 0300) == 0);
  // The C library's umask reports no errors.
  attempt("umask", "", syscall(SYS_umask, 0777) != -1);
}

static void interferes(void) {
  struct rlimit limit = {3, 3};
  struct iovec local = {&limit, 8}, remote = {(void *)0x400000, 8};
  pid_t parent = getppid();
  attempt("signal", "parent", parent > 0 && kill(parent, 0) == 0);
  attempt("signal", "init", kill(1, 0) == 0);
  attempt("signal", "all", kill(-1, 0) == 0);
  attempt("signal", "group", kill(0, 0) == 0);
  attempt("ptrace", "parent", ptrace(PTRACE_ATTACH, parent, 0, 0) == 0);
  attempt("memory", "parent", process_vm_readv(parent, &local, 1, &remote, 1, 0) >= 0);
  attempt("limits", "parent", prlimit(parent, RLIMIT_NOFILE, &limit, NULL) == 0);
  attempt("priority", "parent", setpriority(PRIO_PROCESS, parent, 19) == 0);
  attempt("pidfd", "parent", syscall(434, parent, 0) >= 0);
  attempt("namespace", "", unshare(CLONE_NEWUSER) == 0);
  attempt("mount", "", mount("x", "/", "tmpfs", 0, "") == 0);
  attempt("chroot", "", chroot("../out") == 0);
  attempt("setuid", "", setuid(65533) == 0 && getuid() == 65533);
  attempt("link", "", symlink("/etc", "../out/folder") == 0);
  attempt("pipe", "", mkfifo("../out/pipe.json", 0666) == 0);
  attempt("inotify", "", inotify_add_watch(inotify_init(), SECRET, IN_ACCESS) >= 0);
}

static void *idle(void *nothing) { return nothing; }

int main(int count, char **words) {
  char path[8192];
  struct stat about;
  /* Jobs, and the question for schemas, have their command behind the format of messages. */
  char **all = words;
  if (count > 1 && !strncmp(words[1], "--message-format", 16)) {
    count--;
    words++;
  }
  if (count > 1 && (!strcmp(words[1], "man") || !strcmp(words[1], "catalogue"))) {
    execv(VLSCAN, all);
    return 1;
  }
  if (count > 2 && !strcmp(words[1], "scene")) {
    FILE *frame = fopen("../view/map.pgw", "w");
    if (frame) {
      fprintf(frame, "1\n0\n0\n-1\n0\n0\n");
      fclose(frame);
    }
    /* Hard links need no symlink(2). */
    if (symlink(SECRET, "../view/map.png")) link(SECRET, "../view/map.png");
    return 0;
  }
  if (count > 3 && !strcmp(words[1], "run") && !strcmp(words[3], "--dry-run")) {
    for (int number = 0; number < 3; number++) {
      const char *names[] = {"../tmp/price.json", "../tmp/price.unfinished", "../out/report.unfinished"};
      if (symlink(SECRET, names[number])) link(SECRET, names[number]);
    }
    if (lstat("../tmp/again", &about)) {
      fclose(fopen("../tmp/again", "w"));
      kill(getpid(), SIGKILL);
    }
    printf("{\"pulses\": 5}\n");
    return 0;
  }
  if (count > 1 && !strcmp(words[1], "run")) {
    /* The service is killed meanwhile. */
    prctl(PR_SET_PDEATHSIG, 0);
    setsid();
    signal(SIGTERM, SIG_IGN);
    for (;;) {
      FILE *alive = fopen("../tmp/alive", "a");
      if (alive) {
        fputs("x", alive);
        fclose(alive);
      }
      usleep(10000);
    }
  }
  out = fopen("../out/report.txt", "w");
  if (!out) return 3;
  pthread_t thread;
  fprintf(out, "%s a thread\n", pthread_create(&thread, NULL, idle, NULL) ? "LOST" : "allowed");
  pthread_join(thread, NULL);
  const char *secrets[] = {SECRET, "../log", "../prepared.json", "../../../service.db", "../../../id", "/etc/passwd",
    "/proc/self/environ", "/proc/self/maps", "/proc/self/mountinfo", "/proc/self/cmdline", "/proc/self/root/etc/passwd",
    "/proc/self/cwd/../log", "/proc/1/cmdline", "/usr/lib/os-release", "/etc/os-release", "/dev/mem", "/dev/tty"};
  for (size_t number = 0; number < sizeof secrets / sizeof *secrets; number++) reads(secrets[number]);
  snprintf(path, sizeof path, "/proc/%d/environ", getppid());
  reads(path);
  attempt("list", "jobs", opendir("../..") != NULL);
  attempt("list", "/etc", opendir("/etc") != NULL);
  attempt("list", "home", opendir("/root") != NULL);
  const char *targets[] = {SECRET, "../log", "../prepared.json", "../new", "../in/new", "../in/room/scene.xml", "/tmp/vlscan-takeover",
    "../../../service.db"};
  for (size_t number = 0; number < sizeof targets / sizeof *targets; number++) writes(targets[number]);
  fclose(fopen("../out/own", "w"));
  changes("../out/own");
  changes("../in/room/scene.xml");
  changes("../prepared.json");
  changes(SECRET);
  sees(SECRET, SECRET "-absent");
  sees("/etc/passwd", "/etc/passwd-absent");
  connects();
  multiplies();
  interferes();
  attempt("rename", "../out", rename("../out", "../away") == 0);
  attempt("link", "log", link("../log", "../out/log") == 0);
  attempt("environment", "", getenv("VLSCAN_TOKEN") != NULL || getenv("HOME") != NULL);
  fprintf(out, "end\n");
  fclose(out);
  printf("{}\n");
  fflush(stdout);
  execl("/bin/sh", "sh", "-c", "echo BREACH exec >>../out/report.txt", NULL);
  return 0;
}
