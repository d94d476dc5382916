"""Builds FMUs of a controller from C for tests: FMI 2.0 and 3.0; without gcc these tests are skipped."""

import re
import zipfile
from pathlib import Path

from compile_c import compiled

MODEL = """
#include <stdlib.h>
#include <string.h>
typedef struct { double value[6]; void *log; void *env; char *name; } Model;  /* time v force gain nominal filtered */
static void prepare(Model *m) { m->value[3] = 200; m->value[4] = 20; }
static int advance(Model *m, double t, double h)
{
    double *x = m->value, u;
    x[5] = 0.5 * x[5] + 0.5 * x[1];
    u = x[4] - x[3] * x[5];
    x[2] = u < 0 ? 0 : u > 100 ? 100 : u;
    x[0] = t + h;
    %(more)s
    return 0;
}
"""
TWO = """
#include "fmi2TypesPlatform.h"
#include "fmi2FunctionTypes.h"
%(model)s
#define SAY(status, text) ((fmi2CallbackLogger)m->log)(m->env, m->name, status, "c", text)
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *f, fmi2Boolean visible, fmi2Boolean logging)
{
    Model *m = calloc(1, sizeof *m);
    prepare(m);
    m->log = (void *)f->logger;
    m->env = f->componentEnvironment;
    m->name = strdup(name);
    return m;
}
void fmi2FreeInstance(fmi2Component c) { if (c) free(((Model *)c)->name); free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean d, fmi2Real tol, fmi2Real t, fmi2Boolean s, fmi2Real e)
{ ((Model *)c)->value[0] = t; return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
{ for (size_t i = 0; i < n; i++) v[i] = ((Model *)c)->value[r[i]]; return fmi2OK; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[])
{ for (size_t i = 0; i < n; i++) ((Model *)c)->value[r[i]] = v[i]; return fmi2OK; }
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s)
{ if (!*s) *s = malloc(sizeof(Model)); memcpy(*s, c, sizeof(Model)); return fmi2OK; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { memcpy(c, s, sizeof(Model)); return fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) { free(*s); *s = 0; return fmi2OK; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean same)
{ Model *m = c; int status = advance(m, t, h); %(step)s return status; }
"""
THREE = """
#include "fmi3PlatformTypes.h"
#include "fmi3FunctionTypes.h"
%(model)s
#define SAY(status, text) ((fmi3LogMessageCallback)m->log)(m->env, status, "c", text)
const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String s[]) { return fmi3OK; }
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event,
    fmi3Boolean early, const fmi3ValueReference r[], size_t n, fmi3InstanceEnvironment env, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    Model *m = calloc(1, sizeof *m);
    prepare(m);
    m->log = (void *)log;
    m->env = env;
    return m;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean d, fmi3Float64 tol, fmi3Float64 t, fmi3Boolean s,
                                       fmi3Float64 e) { ((Model *)c)->value[0] = t; return fmi3OK; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], size_t k)
{ for (size_t i = 0; i < n; i++) v[i] = ((Model *)c)->value[r[i]]; return fmi3OK; }
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[], size_t k)
{ for (size_t i = 0; i < n; i++) ((Model *)c)->value[r[i]] = v[i]; return fmi3OK; }
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s)
{ if (!*s) *s = malloc(sizeof(Model)); memcpy(*s, c, sizeof(Model)); return fmi3OK; }
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) { memcpy(c, s, sizeof(Model)); return fmi3OK; }
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *s) { free(*s); *s = 0; return fmi3OK; }
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean same, fmi3Boolean *event,
                      fmi3Boolean *ends, fmi3Boolean *early, fmi3Float64 *last)
{
    Model *m = c;
    int status = advance(m, t, h);
    *event = *ends = *early = 0;
    *last = t + h;
    %(step)s
    return status;
}
"""
UNITS = """<UnitDefinitions>
  <Unit name="mm per s"><BaseUnit m="1" s="-1" factor="0.001"/></Unit>
  <Unit name="meter/sec"><BaseUnit m="1" s="-1"/></Unit>
  <Unit name="Newton"><BaseUnit kg="1" m="1" s="-2"/></Unit>
  <Unit name="N.s/mm"><BaseUnit kg="1" s="-1" factor="1000"/></Unit>
  <Unit name="N.s/m"><BaseUnit kg="1" s="-1"/></Unit>
</UnitDefinitions>"""
XML_TWO = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="nf" guid="{{x}}" numberOfEventIndicators="0">
<CoSimulation modelIdentifier="nf" canHandleVariableCommunicationStepSize="{variable}" canGetAndSetFMUstate="{state}"/>
{units}
<DefaultExperiment startTime="0" stepSize="{step}"/>
<ModelVariables>
  <ScalarVariable name="v" valueReference="1" causality="input" variability="continuous">
    <Real start="0" unit="{v}"/></ScalarVariable>
  <ScalarVariable name="force" valueReference="2" causality="output" variability="continuous" initial="calculated">
    <Real unit="Newton"/></ScalarVariable>
  <ScalarVariable name="gain" valueReference="3" causality="parameter" variability="tunable" initial="exact">
    <Real start="{start}" unit="{gain}" min="0" max="{most}"/></ScalarVariable>
  <ScalarVariable name="nominal" valueReference="4" causality="parameter" variability="fixed" initial="exact">
    <Real start="20" unit="Newton"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2"{depends}/></Outputs><InitialUnknowns><Unknown index="2"/></InitialUnknowns>
</ModelStructure>
</fmiModelDescription>"""
XML_THREE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="nf" instantiationToken="{{x}}">
<CoSimulation modelIdentifier="nf" canHandleVariableCommunicationStepSize="{variable}" canGetAndSetFMUState="{state}"/>
{units}
<DefaultExperiment startTime="0" stepSize="{step}"/>
<ModelVariables>
  <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
  <Float64 name="v" valueReference="1" causality="input" variability="continuous" start="0" unit="{v}"/>
  <Float64 name="force" valueReference="2" causality="output" variability="continuous" initial="calculated"
    unit="Newton"/>
  <Float64 name="gain" valueReference="3" causality="parameter" variability="tunable" initial="exact" start="{start}"
    unit="{gain}" min="0" max="{most}"/>
  <Float64 name="nominal" valueReference="4" causality="parameter" variability="fixed" initial="exact" start="20"
    unit="Newton"/>
</ModelVariables>
<ModelStructure><Output valueReference="2"{depends}/><InitialUnknown valueReference="2"/></ModelStructure>
</fmiModelDescription>"""
DESCRIBED = {
    "variable": "true",
    "state": "true",
    "units": UNITS,
    "step": "0.001",
    "v": "meter/sec",
    "start": "200",
    "gain": "N.s/m",
    "most": "1000",
    "depends": "",
}


def stubs(text, version):
    """Functions of FMI that `text` does not define; fmpy looks for all of them."""
    import fmpy

    header = (Path(fmpy.__file__).parent / "c-code" / f"fmi{version}Functions.h").read_text()
    names = re.findall(r"^\s*FMI\d_Export fmi\w+TYPE\s+(fmi\w+);", header, re.MULTILINE)
    return "\n".join(f"int {name}(void) {{ return 3; }}" for name in names if not re.search(rf"\b{name}\(", text))


def unit(path, version=2, more="", step="", platform=None, **described):
    """The FMU `path` (NAME.fmu) of a controller; `more`: C at the end of a step, `step`: C with its results."""
    import fmpy

    model = MODEL % {"more": more}
    text = (TWO if version == 2 else THREE) % {"model": model, "step": step}
    text += stubs(text, version)
    headers = str(Path(fmpy.__file__).parent / "c-code")
    library = compiled(path.with_suffix(".so"), text, "-I", headers, "-Wno-unused-function")
    platform = platform or ("linux64" if version == 2 else fmpy.platform_tuple)
    xml = (XML_TWO if version == 2 else XML_THREE).format(**{**DESCRIBED, **described})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", xml)
        archive.write(library, f"binaries/{platform}/nf.so")
    return path
