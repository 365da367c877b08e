/* What pyblast-run asks of the system: a result that is whole or absent, whatever ends the program. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char part[PATH_MAX + 8]; /* written beside the result, then renamed; empty: there is none */

static int exists(const char *path, struct stat *found) { return lstat(path, found) == 0; }

/* Say one sentence, leave no part of a result, and end without the work of other libraries at exit:
   HDF5 would write again to a disk that is full. */
void pyblast_end(const char *text, int code)
{
    const char *pieces[] = {"pyblast-run: ", text, "\n"};
    int n;

    if (part[0]) unlink(part);
    for (n = 0; n < 3; n++)
        if (write(STDERR_FILENO, pieces[n], strlen(pieces[n])) < 0) break;
    _exit(code);
}

static void interrupted(int number)
{
    (void)number;
    pyblast_end("interrupted; no result is written", 130);
}

/* Say that the result can't be written, and why if the system knows. */
static void refuse(const char *result, const char *why)
{
    char text[2 * PATH_MAX];

    snprintf(text, sizeof text, "%s: can't be written (%s)", result, why);
    pyblast_end(text, 2);
}

/* Begin a result: end with one sentence if its place can't be written or holds what is no file. */
void pyblast_begin_result(const char *model, const char *result)
{
    static const int numbers[] = {SIGINT, SIGTERM};
    struct stat own, other;
    size_t n;
    int file;

    signal(SIGXFSZ, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    if (strlen(result) >= PATH_MAX) refuse("RESULT", "its path is too long");
    if (exists(result, &own)) {
        if (!S_ISREG(own.st_mode)) refuse(result, "what stands there is no regular file");
        if (stat(model, &other) == 0 && own.st_dev == other.st_dev && own.st_ino == other.st_ino)
            refuse(result, "it is the model; name another file");
    }
    snprintf(part, sizeof part, "%s.part", result);
    if (exists(part, &own) && !S_ISREG(own.st_mode)) {
        part[0] = 0;
        refuse(result, "beside it, the name with .part is taken by what is no regular file");
    }
    unlink(part);
    file = open(part, O_WRONLY | O_CREAT | O_EXCL, 0666);
    if (file < 0) {
        part[0] = 0;
        refuse(result, strerror(errno));
    }
    close(file);
    for (n = 0; n < sizeof numbers / sizeof *numbers; n++) signal(numbers[n], interrupted);
    errno = 0;
}

/* End with one sentence after a write that failed. */
void pyblast_fail_result(const char *result)
{
    refuse(result, errno ? strerror(errno) : "is the disk full?");
}

/* Give the whole result its name. */
void pyblast_put_in_place(const char *result)
{
    struct stat own;
    int file = open(part, O_RDWR);

    if (file < 0 || fsync(file) != 0 || close(file) != 0) refuse(result, strerror(errno));
    if (exists(result, &own) && !S_ISREG(own.st_mode)) refuse(result, "what stands there is no regular file");
    if (rename(part, result) != 0) refuse(result, strerror(errno));
    part[0] = 0;
}
