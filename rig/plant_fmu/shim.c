/* An FMU for co-simulation (FMI 2.0) whose model is a rig in a child process; compiled by `rig fmu` with
 *
 *     -DGUID="..." -DINPUTS=2 -DOUTPUTS=12 -DSEED=0 -DPYTHON="..." -DNAMES='"load.force",'
 *
 * The child is `PYTHON -P -m rig.plant_fmu.child resources/scene.json`, at the other end of a socket. A request is the kind
 * (0 start, 1 step), the time or seed, the step, and the inputs, as doubles; an answer is a status (0: well), the outputs,
 * and a text of TEXT bytes. An input that was never set is NaN: it belongs to the protocol of the scene. Every wait is
 * bounded. A child that hangs is killed, one that has ended is an error; without this end the child ends by itself.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define TEXT 512
#define CHILD_END 3 /* descriptor of the socket in the child */
#define LEAVE_MS 2000
#define TIMEOUT (INPUTS + OUTPUTS) /* value reference */
#define LONGEST_S 1e6              /* longest timeout */

static const char *const NAMES_OF_INPUTS[] = {NAMES ""};

extern char **environ;

typedef void *Component;
typedef unsigned int Reference;
typedef int Status;
enum { OK, WARNING, DISCARD, ERROR, FATAL };
typedef void (*Logger)(void *environment, const char *name, Status, const char *category, const char *text, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, Status);
    void *environment;
} Callbacks;

typedef struct {
    char *name, *scene, *python;
    Logger logger;
    void *environment;
    pid_t child;
    int link, seed;
    double start, timeout, input[INPUTS + 1], output[OUTPUTS + 1];
} Model;

struct request { double kind, time, step, input[INPUTS]; };
struct answer { double status, output[OUTPUTS]; char text[TEXT]; };

static Status say(Model *m, Status status, const char *text)
{
    if (m->logger) m->logger(m->environment, m->name, status, status == ERROR ? "logStatusError" : "logAll", "%s", text);
    return status;
}

static long now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000L + t.tv_nsec / 1000000L;
}

/* Wait for the end of the child for at most `ms`; returns whether it has ended, and how. */
static int ended(Model *m, long ms, int *how)
{
    for (long until = now_ms() + ms;;) {
        pid_t found = waitpid(m->child, how, WNOHANG);
        if (found == m->child || (found < 0 && errno == ECHILD)) return 1;
        if (now_ms() >= until) return 0;
        usleep(2000);
    }
}

static void end_child(Model *m)
{
    int how;
    if (m->link >= 0) close(m->link);
    m->link = -1;
    if (m->child > 0 && !ended(m, LEAVE_MS, &how)) {
        kill(m->child, SIGKILL);
        waitpid(m->child, &how, 0);
    }
    m->child = 0;
}

/* The child does not answer: say what it did, and end it if it is still there. */
static Status lost(Model *m, const char *what)
{
    char text[TEXT];
    int how = 0, gone = ended(m, 200, &how);
    if (!gone)
        snprintf(text, sizeof text, "the rig did not answer within %g s %s; its process %ld was ended", m->timeout, what,
                 (long)m->child);
    else if (WIFSIGNALED(how))
        snprintf(text, sizeof text, "the process of the rig was ended by signal %d %s", WTERMSIG(how), what);
    else
        snprintf(text, sizeof text, "the process of the rig ended with code %d %s (%s -m rig.plant_fmu.child)",
                 WEXITSTATUS(how), what, m->python);
    if (gone)
        m->child = 0; /* its number may belong to another process by now */
    else
        kill(m->child, SIGKILL);
    end_child(m);
    return say(m, ERROR, text);
}

/* Exchange bytes until `until`; returns whether all were. */
static int carry(int link, void *bytes, size_t size, short event, long until)
{
    for (char *at = bytes; size;) {
        struct pollfd one = {link, event, 0};
        long left = until - now_ms();
        int ready = poll(&one, 1, left > 0 ? (int)left : 0);
        if (ready < 0 && errno == EINTR) continue;
        if (ready <= 0) return 0;
        ssize_t done = event == POLLIN ? recv(link, at, size, MSG_DONTWAIT)
                                       : send(link, at, size, MSG_DONTWAIT | MSG_NOSIGNAL);
        if (done < 0 && (errno == EAGAIN || errno == EINTR)) continue;
        if (done <= 0) return 0;
        at += done;
        size -= (size_t)done;
    }
    return 1;
}

static Status ask(Model *m, double kind, double time, double step, const char *what)
{
    struct request request = {kind, time, step, {0}};
    struct answer answer;
    long until = now_ms() + (long)(1e3 * m->timeout);
    if (m->link < 0) return say(m, ERROR, "the rig is not running");
    memcpy(request.input, m->input, sizeof request.input);
    if (!carry(m->link, &request, sizeof request, POLLOUT, until) || !carry(m->link, &answer, sizeof answer, POLLIN, until))
        return lost(m, what);
    memcpy(m->output, answer.output, sizeof answer.output);
    answer.text[TEXT - 1] = 0;
    return answer.status == 0.0 ? OK : say(m, ERROR, answer.text);
}

static Status begin(Model *m)
{
    char *arguments[] = {m->python, "-P", "-m", "rig.plant_fmu.child", m->scene, NULL};
    posix_spawn_file_actions_t files;
    posix_spawnattr_t how;
    sigset_t none, all;
    int link[2], fault;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, link)) return say(m, ERROR, "no socket is left");
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, link[1], CHILD_END);
    posix_spawnattr_init(&how);
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&how, &none);
    posix_spawnattr_setsigdefault(&how, &all);
    posix_spawnattr_setflags(&how, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    fault = posix_spawnp(&m->child, m->python, &files, &how, arguments, environ);
    posix_spawn_file_actions_destroy(&files);
    posix_spawnattr_destroy(&how);
    close(link[1]);
    if (fault) {
        char text[TEXT];
        snprintf(text, sizeof text, "%s cannot be started: %s; set the parameter `python` to a Python with friction-rig",
                 m->python, strerror(fault));
        close(link[0]);
        m->child = 0;
        return say(m, ERROR, text);
    }
    m->link = link[0];
    return OK;
}

static void prepare(Model *m)
{
    for (int i = 0; i < INPUTS; i++) m->input[i] = NAN;
    for (int i = 0; i < OUTPUTS; i++) m->output[i] = 0.0;
    m->start = 0.0;
}

/* The path of the scene from the location of the resources, which is a URI. */
static char *scene_at(const char *uri)
{
    const char *tail = "/scene.json";
    char *found = malloc(strlen(uri) + strlen(tail) + 1), *to = found;
    if (!strncmp(uri, "file://", 7)) uri += 7;
    else if (!strncmp(uri, "file:", 5)) uri += 5;
    for (; *uri; uri++) {
        unsigned int code;
        if (*uri == '%' && sscanf(uri + 1, "%2x", &code) == 1) {
            *to++ = (char)code;
            uri += 2;
        } else
            *to++ = *uri;
    }
    strcpy(to, tail);
    return found;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
Status fmi2SetDebugLogging(Component c, int on, size_t n, const char *const categories[]) { return OK; }

Component fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources, const Callbacks *calls,
                          int visible, int logging)
{
    Model *m;
    if (kind != 1 || strcmp(guid, GUID)) return NULL; /* 1: co-simulation */
    m = calloc(1, sizeof *m);
    m->name = strdup(name);
    m->scene = scene_at(resources);
    m->python = strdup(PYTHON);
    m->logger = calls->logger;
    m->environment = calls->environment;
    m->link = -1;
    m->seed = SEED;
    m->timeout = 60.0;
    prepare(m);
    return m;
}

void fmi2FreeInstance(Component c)
{
    Model *m = c;
    if (!m) return;
    end_child(m);
    free(m->name);
    free(m->scene);
    free(m->python);
    free(m);
}

Status fmi2SetupExperiment(Component c, int defined, double tolerance, double start, int ends, double stop)
{
    ((Model *)c)->start = start;
    return OK;
}

Status fmi2EnterInitializationMode(Component c)
{
    Model *m = c;
    Status status = m->link < 0 ? begin(m) : OK;
    return status ? status : ask(m, 0.0, m->seed, m->start, "while it started");
}

Status fmi2ExitInitializationMode(Component c) { return OK; }

Status fmi2Terminate(Component c)
{
    end_child(c);
    return OK;
}

Status fmi2Reset(Component c) /* the child stays: it starts again within a millisecond */
{
    prepare(c);
    return OK;
}

Status fmi2DoStep(Component c, double time, double step, int same)
{
    char what[80];
    snprintf(what, sizeof what, "in the step from t = %.9g s", time);
    return ask(c, 1.0, time, step, what);
}

Status fmi2GetReal(Component c, const Reference at[], size_t n, double value[])
{
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        if (at[i] > TIMEOUT) return ERROR;
        value[i] = at[i] == TIMEOUT ? m->timeout : at[i] < INPUTS ? m->input[at[i]] : m->output[at[i] - INPUTS];
    }
    return OK;
}

Status fmi2SetReal(Component c, const Reference at[], size_t n, const double value[])
{
    Model *m = c;
    char text[TEXT];
    for (size_t i = 0; i < n; i++) {
        if (at[i] < INPUTS && !isfinite(value[i])) {
            snprintf(text, sizeof text, "the input %s was set to %g; a command is a finite number. The value before it stays",
                     NAMES_OF_INPUTS[at[i]], value[i]);
            return say(m, ERROR, text);
        }
        if (at[i] == TIMEOUT && value[i] > 0.0 && value[i] <= LONGEST_S) m->timeout = value[i];
        else if (at[i] < INPUTS) m->input[at[i]] = value[i];
        else return say(m, ERROR, "only inputs and parameters can be set; the timeout is above 0 s, at most 1e6 s");
    }
    return OK;
}

Status fmi2GetInteger(Component c, const Reference at[], size_t n, int value[])
{
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->seed;
    return OK;
}

Status fmi2SetInteger(Component c, const Reference at[], size_t n, const int value[])
{
    for (size_t i = 0; i < n; i++) {
        if (at[i] || value[i] < 0) return say(c, ERROR, "the seed is a whole number, at least 0");
        ((Model *)c)->seed = value[i];
    }
    return OK;
}

Status fmi2GetString(Component c, const Reference at[], size_t n, const char *value[])
{
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->python;
    return OK;
}

Status fmi2SetString(Component c, const Reference at[], size_t n, const char *const value[])
{
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        free(m->python);
        m->python = strdup(value[i]);
    }
    return OK;
}

Status fmi2GetBoolean(Component c, const Reference at[], size_t n, int value[]) { return n ? ERROR : OK; }
Status fmi2SetBoolean(Component c, const Reference at[], size_t n, const int value[]) { return n ? ERROR : OK; }
Status fmi2GetFMUstate(Component c, void **state) { return ERROR; }
Status fmi2SetFMUstate(Component c, void *state) { return ERROR; }
Status fmi2FreeFMUstate(Component c, void **state) { return ERROR; }
Status fmi2SerializedFMUstateSize(Component c, void *state, size_t *size) { return ERROR; }
Status fmi2SerializeFMUstate(Component c, void *state, char bytes[], size_t size) { return ERROR; }
Status fmi2DeSerializeFMUstate(Component c, const char bytes[], size_t size, void **state) { return ERROR; }
Status fmi2GetDirectionalDerivative(Component c, const Reference of[], size_t n, const Reference by[], size_t k,
                                    const double d[], double found[]) { return ERROR; }
Status fmi2SetRealInputDerivatives(Component c, const Reference at[], size_t n, const int order[], const double v[])
{ return n ? ERROR : OK; }
Status fmi2GetRealOutputDerivatives(Component c, const Reference at[], size_t n, const int order[], double v[])
{ return n ? ERROR : OK; }
Status fmi2CancelStep(Component c) { return ERROR; }
Status fmi2GetStatus(Component c, int kind, Status *value) { return DISCARD; }
Status fmi2GetRealStatus(Component c, int kind, double *value) { return DISCARD; }
Status fmi2GetIntegerStatus(Component c, int kind, int *value) { return DISCARD; }
Status fmi2GetBooleanStatus(Component c, int kind, int *value) { return DISCARD; }
Status fmi2GetStringStatus(Component c, int kind, const char **value) { return DISCARD; }
