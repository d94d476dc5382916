// The catalogue: English text -> German text. A test finds texts of the page, words of plants and names of channels that are
// missing here.

export const german = {
  // head and views
  Rigs: "Prüfstände", Bench: "Versuch", Recordings: "Aufnahmen", Analysis: "Analyse", Lessons: "Lektionen", views: "Ansichten", rig: "Prüfstand",
  "no run yet": "noch kein Lauf", starting: "startet", running: "läuft", paused: "angehalten", ending: "endet", ended: "beendet",
  "not connected": "nicht verbunden", pace: "Tempo", "EMERGENCY STOP": "NOT-HALT",
  "all actuators to their safe values at once; half a second later the run ends": "alle Stellglieder sofort auf sichere Werte; eine halbe Sekunde später endet der Lauf",

  // opening
  Start: "Start", demonstration: "Vorführung", "Why does it squeal, and what stops it?": "Warum quietscht es, und was hilft dagegen?",
  "A test rig for friction-induced vibration, in real time. Start this pendulum: it sticks and slips. Then move a slider until it is quiet.":
    "Ein Prüfstand für reiberregte Schwingungen, in Echtzeit. Starten Sie dieses Pendel: Es haftet und gleitet. Bewegen Sie dann einen Schieber, bis es ruhig ist.",
  "Search all rigs: squeal, seal, dither, shunt": "Alle Prüfstände durchsuchen (englisch): squeal, seal, dither, shunt",
  "search rigs": "Prüfstände suchen", "no rig has these words": "kein Prüfstand enthält diese Wörter",
  "Stick-slip": "Haften und Gleiten", "Mode coupling": "Modenkopplung", "Brake and shunt": "Bremse und Shunt", Measured: "Gemessen",
  "Pendulum on a disc": "Pendel auf einer Scheibe",
  "It sticks to the turning disc, tears off, and swings back three times a second.": "Es haftet an der drehenden Scheibe, reißt ab und schwingt dreimal in der Sekunde zurück.",
  "Mass on a belt": "Masse auf einem Band", "The belt carries the mass along until the spring pulls it back.": "Das Band nimmt die Masse mit, bis die Feder sie zurückzieht.",
  "With a tuned mass": "Mit Tilger", "A small tilted mass on top takes the vibration away.": "Eine kleine schräge Masse darauf nimmt die Schwingung weg.",
  "With a piezo stack": "Mit Piezostapel", "A circuit makes the spring softer, and the rhythm changes.": "Eine Schaltung macht die Feder weicher, und der Takt ändert sich.",
  "Two springs, one mass": "Zwei Federn, eine Masse", "Friction joins two vibrations, and together they grow.": "Reibung verbindet zwei Schwingungen, und zusammen wachsen sie.",
  "Three bodies on a belt": "Drei Körper auf einem Band", "The middle body begins to hop on the belt.": "Der mittlere Körper beginnt auf dem Band zu hüpfen.",
  "Tilted pin": "Schräger Stift", "Tilted against the motion, the pin digs in and hammers the disc.": "Gegen die Bewegung geneigt, beißt der Stift und hämmert auf die Scheibe.",
  "Flutter of a pad": "Flattern eines Belags", "A pad that can tilt and move flutters 2274 times a second.": "Ein Belag, der kippen und sich heben kann, flattert 2274-mal in der Sekunde.",
  "Slider on a bending disc": "Gleiter auf biegsamer Scheibe", "The disc bends under a slider that sticks in every period.": "Die Scheibe biegt sich unter einem Gleiter, der in jeder Periode haftet.",
  "Disc brake": "Scheibenbremse", "Pads, calliper and disc squeal at 2.1 kHz.": "Beläge, Sattel und Scheibe quietschen mit 2.1 kHz.",
  "Brake with a shunt": "Bremse mit Shunt", "A coil across a piezo stack silences the squeal.": "Eine Spule an einem Piezostapel bringt das Quietschen zum Schweigen.",
  "Plate under a slider": "Platte unter einem Gleiter",
  "The film between them opens at some points, then everywhere, and the motion is chaotic.": "Der Film zwischen ihnen öffnet sich an einigen Punkten, dann überall, und die Bewegung ist chaotisch.",
  "Slider with a lever": "Gleiter mit Hebel",
  "Its parameters are identified from measurements; below 2 rpm it sticks and slips.": "Seine Parameter sind aus Messungen bestimmt; unter 2 rpm haftet und gleitet er.",
  "Seal on a bolt": "Dichtung auf einem Bolzen",
  "A friction curve that was measured on a seal, and the vibration that it makes.": "Eine an einer Dichtung gemessene Reibkennlinie und die Schwingung, die sie erzeugt.",
  "Tip on a disc": "Spitze auf einer Scheibe", "Sliding or sticking: both are stable, and a knock decides.": "Gleiten oder Haften: Beides ist stabil, und ein Stoß entscheidet.",
  "Tread block": "Profilblock", "The edge of a rubber block squeaks on glass at 294 Hz.": "Die Kante eines Gummiblocks quietscht auf Glas mit 294 Hz.",

  // bench
  Pause: "Pause", Resume: "Weiter", "Single step": "Einzelschritt", "one frame of the paused run": "ein Takt des angehaltenen Laufs", Stop: "Stopp", Knock: "Stoß",
  "impulse of the knock in N s": "Impuls des Stoßes in N s", "impulse in N s": "Impuls in N s", "This rig": "Dieser Prüfstand", values: "Werte", time: "Zeit",
  duration: "Dauer", "duration in s": "Dauer in s", "as the protocol": "wie das Protokoll", Effects: "Effekte", "Save these values as a scene": "Diese Werte als Szene speichern",
  Save: "Speichern", name: "Name", "name of the new scene": "Name der neuen Szene", "this folder": "dieser Ordner", "Messages of the run": "Meldungen des Laufs",
  "Whole summary": "Ganze Zusammenfassung", "Look at the recording": "Aufnahme ansehen", "Runs of other terminals": "Läufe anderer Terminals", Follow: "Folgen",
  "none; runs of other users are not shown": "keine; Läufe anderer Benutzer werden nicht gezeigt", "Look again": "Noch einmal suchen", "Stop following": "Nicht mehr folgen",
  "the run continues": "der Lauf geht weiter", "moving picture of the rig": "bewegtes Bild des Prüfstands", "at rest": "in Ruhe",
  "The plant of this scene declares no picture. Its outputs now, each as a share of the largest so far.": "Für diesen Prüfstand gibt es kein Bild. Seine Ausgänge jetzt, jeder als Anteil des bisher größten Werts.",
  "The picture of this plant cannot be drawn:": "Das Bild dieses Prüfstands kann nicht gezeichnet werden:",
  "The plant of this scene declares no picture; its outputs are shown when it runs.": "Für diesen Prüfstand gibt es kein Bild; seine Ausgänge erscheinen, wenn er läuft.",
  Events: "Ereignisse", "phase portrait": "Phasenbild", "Phase portrait": "Phasenbild", "this rig has no pair of displacement and velocity": "dieser Prüfstand hat kein Paar aus Weg und Geschwindigkeit",
  "across {x}, up {y}; every step of the last {time}": "quer {x}, hoch {y}; jeder Schritt der letzten {time}",
  protocol: "Protokoll", "repeat for ever": "endlos wiederholen", "repeat {times} times": "{times}-mal wiederholen", "{seconds} s left": "noch {seconds} s", "round {round}": "Runde {round}",

  // values by hand
  "Move a value, see what happens": "Einen Wert bewegen und zusehen", "find a value: mass, gain, rate": "einen Wert finden: mass, gain, rate", "find a value": "einen Wert finden",
  "All other values ({count})": "Alle anderen Werte ({count})", "not set": "nicht gesetzt", logarithmic: "logarithmisch", "driven by {owner}": "von {owner} gestellt",
  "{owner} drives {key}: the value takes effect when {owner} is disconnected": "{owner} stellt {key}: Der Wert gilt, sobald {owner} getrennt ist",
  "controller {name} drives {what}": "Regler {name} stellt {what}", Connect: "Verbinden", Disconnect: "Trennen",
  "gain of the controller": "Verstärkung des Reglers", "amplitude of the controller": "Amplitude des Reglers", "belt speed": "Bandgeschwindigkeit", "disc speed": "Scheibendrehzahl",
  "normal force": "Normalkraft", "friction coefficient at rest": "Haftreibwert", "friction coefficient in motion": "Gleitreibwert", "coefficient of friction": "Reibwert", damping: "Dämpfung", "damping ratio": "Dämpfungsgrad",
  "stiffness of the spring": "Federsteifigkeit", "dither amplitude": "Ditheramplitude", "damping of the lever": "Dämpfung des Hebels", "stiffness of the beam": "Steifigkeit des Balkens",
  "speed of the glass": "Geschwindigkeit des Glases", "damping along the glass": "Dämpfung entlang des Glases", "angle of the first spring": "Winkel der ersten Feder",
  "damping of the first spring": "Dämpfung der ersten Feder", "angle of the inclined spring": "Winkel der schrägen Feder", "damping of the slider": "Dämpfung des Gleiters",
  "tilt of the pin": "Neigung des Stifts", "damping of the pin": "Dämpfung des Stifts", "speed of the slider": "Geschwindigkeit des Gleiters", "damping of the tilt": "Dämpfung des Kippens",
  "offset of the lining": "Versatz des Belags", "stiffness of the contact": "Steifigkeit des Kontakts", "brake pressure": "Bremsdruck", "damping (loss factor)": "Dämpfung (Verlustfaktor)",
  "resistance of the shunt": "Widerstand des Shunts", "inductance of the shunt": "Induktivität des Shunts",

  // maps beside the sliders
  "branches and the present state": "Äste und der jetzige Zustand", "branches over": "Äste über", "branches: over": "Äste: über", "branches: from": "Äste: von", "branches: to": "Äste: bis",
  "no branch is computed yet for these values": "für diese Werte ist noch kein Ast berechnet", "{name} at {value}": "{name} bei {value}", "line: {at}": "Linie: {at}",
  "dot: the run at {at}, with its extremes of the last second": "Punkt: der Lauf bei {at}, mit den Extremwerten der letzten Sekunde",
  "full: stable, dashed: unstable, from violet (slip) to yellow (stick)": "durchgezogen: stabil, gestrichelt: instabil, von violett (gleiten) bis gelb (haften)",
  "the run has other values:": "der Lauf hat andere Werte:", "Draw the map of a value: where it slides, sticks, vibrates": "Karte eines Werts zeichnen: wo es gleitet, haftet, schwingt",
  from: "von", to: "bis", "stable and unstable motions; most rigs take seconds": "stabile und instabile Bewegungen; bei den meisten Prüfständen Sekunden", Compute: "Berechnen",

  // time axis
  "contacts, curves and events over time; arrow keys move the cursor, + and - zoom": "Kontakte, Kurven und Ereignisse über der Zeit; Pfeiltasten bewegen den Cursor, + und - zoomen",
  "Curves, contacts and events appear here when the rig moves.": "Kurven, Kontakte und Ereignisse erscheinen hier, wenn sich der Prüfstand bewegt.",
  channels: "Kanäle", "Hold the view": "Ansicht anhalten", measured: "gemessen", contact: "Kontakt", "show the last {span} s": "die letzten {span} s zeigen", "zoom in": "hineinzoomen", "zoom out": "herauszoomen",

  // trust
  "times can be trusted": "den Zeiten kann man trauen", "times can be trusted with care": "den Zeiten kann man mit Vorsicht trauen", "do not trust times of this run": "den Zeiten dieses Laufs nicht trauen",
  "timing and energy of this run": "Zeittreue und Energie dieses Laufs", "{late} % late": "{late} % spät", "energy {energy}": "Energie {energy}", timing: "Zeittreue", "so far: ": "bisher: ",
  "this run does not follow the clock": "dieser Lauf folgt nicht der Uhr", "not judged yet": "noch nicht beurteilt", because: "weil", "late frames": "späte Takte",
  "{late} of {all}; 99 of 100 begin at most {most} ms late, the worst {worst} ms": "{late} von {all}; 99 von 100 beginnen höchstens {most} ms zu spät, der schlechteste {worst} ms",
  loop: "Regelkreis", "{held} commands held because no new one arrived, {lost} lost": "{held} Stellwerte gehalten, weil kein neuer kam, {lost} verloren", energy: "Energie",
  "residual of the energy balance: {energy} of the largest term": "Rest der Energiebilanz: {energy} des größten Terms", "not known": "nicht bekannt", stick: "Haften",
  "{share} % of the time": "{share} % der Zeit", refused: "abgelehnt", "{count} messages": "{count} Nachrichten", "this page": "diese Seite",
  "{dropped} pictures left out, {lost} messages lost on the way to the server": "{dropped} Bilder ausgelassen, {lost} Nachrichten auf dem Weg zum Server verloren",

  // sound
  Sound: "Ton", "sensor to hear": "Sensor zum Hören", Listen: "Hören", Silence: "Stille", volume: "Lautstärke", "silent: no samples arrive": "still: es kommen keine Abtastwerte an",
  "This run does not follow the clock: its sound would not be steady. Start it at a pace, such as 1.": "Dieser Lauf folgt nicht der Uhr: Sein Ton wäre nicht gleichmäßig. Starten Sie ihn mit einem Tempo, etwa 1.",
  "This browser cannot play {rate} samples per second ({name} at pace {pace}). Choose a pace nearer to 1, or another sensor.":
    "Dieser Browser kann {rate} Abtastwerte je Sekunde nicht abspielen ({name} bei Tempo {pace}). Wählen Sie ein Tempo näher an 1 oder einen anderen Sensor.",
  "This browser does not play the sound:": "Dieser Browser spielt den Ton nicht:", "The connection for the sound was interrupted; press Listen again.": "Die Verbindung für den Ton brach ab; drücken Sie noch einmal Hören.",
  "{level} (0 dB is {reference} {unit}); full scale of the loudspeaker: {full} {unit}": "{level} (0 dB sind {reference} {unit}); Vollausschlag des Lautsprechers: {full} {unit}",
  "played at {pace} times the speed, so that the pitch is that of the pace": "mit {pace}-facher Geschwindigkeit gespielt, daher in anderer Tonhöhe",
  "{stored} ms in store, gaps: {gaps}, {late} s dropped because it was late": "{stored} ms Vorrat, Lücken: {gaps}, {late} s verworfen, weil zu spät",

  // recordings
  recording: "Aufnahme", "no recordings yet: every run makes one": "noch keine Aufnahmen: jeder Lauf macht eine", Play: "Abspielen", "instant of the recording": "Zeitpunkt der Aufnahme", Hear: "Anhören",
  "the sound of its microphone": "der Ton des Mikrofons", Spectrum: "Spektrum", Report: "Bericht", "a page with figures": "eine Seite mit Bildern", Verify: "Prüfen",
  "simulate it again and compare every bit": "noch einmal simulieren und jedes Bit vergleichen", Tables: "Tabellen", "CSV, as a ZIP file": "CSV, als ZIP-Datei", "the full view in rerun": "die volle Ansicht in rerun",
  "compare with": "vergleichen mit", "from the instant of the cursor with": "ab dem Zeitpunkt des Cursors mit", "Continue from here": "Von hier fortsetzen", "value to change": "zu ändernder Wert", "new value": "neuer Wert",

  // jobs, analysis, lessons
  working: "arbeitet", done: "fertig", stopped: "gestoppt", ", exit code {code}": ", Code {code}", "open the result": "Ergebnis öffnen",
  "Analyse a rig": "Einen Prüfstand analysieren", "on the bench:": "im Versuch:", "value of the rig": "Wert des Prüfstands", over: "über", "and over": "und über", Eigenvalues: "Eigenwerte",
  "frequency and growth rate of each vibration mode": "Frequenz und Wachstumsrate jeder Eigenform", "Map by simulation": "Karte durch Simulation", "Map by eigenvalues": "Karte durch Eigenwerte",
  "where sliding is unstable, over two values; seconds": "wo Gleiten instabil ist, über zwei Werten; Sekunden", "Cost table": "Kostentabelle", "Maps and cost tables of this folder": "Karten und Kostentabellen dieses Ordners",
  "none yet in this folder": "noch keine in diesem Ordner", "unfinished: start it again and it continues": "unfertig: noch einmal starten, dann geht es weiter",
  "With its changed values: eigenvalues take seconds. A map simulates many runs, a cost table compares methods and steps. Both take minutes to hours and all processors: do not start them beside a run whose timing matters. Results of a stopped job are kept.":
    "Mit den geänderten Werten: Eigenwerte dauern Sekunden. Eine Karte simuliert viele Läufe, eine Kostentabelle vergleicht Verfahren und Schritte. Beide dauern Minuten bis Stunden und brauchen alle Prozessoren: nicht neben einem Lauf starten, dessen Zeittreue zählt. Ergebnisse eines gestoppten Auftrags bleiben erhalten.",
  lesson: "Lektion", "Put its rig on the bench": "Den Prüfstand dazu öffnen", Run: "Ausführen",

  // channels
  velocity: "Geschwindigkeit", "surface speed": "Oberflächengeschwindigkeit", vibrometer: "Vibrometer", forces: "Kräfte", "friction force": "Reibkraft", displacement: "Weg", laser: "Laser",
  acceleration: "Beschleunigung", accelerometer: "Beschleunigungsaufnehmer", "slip speed": "Gleitgeschwindigkeit", "contact temperature rise": "Temperaturanstieg im Kontakt",
  "contact deflection": "Kontaktverformung", "contact deflection 1": "Kontaktverformung 1", "contact deflection 2": "Kontaktverformung 2", "contact deflection 3": "Kontaktverformung 3",
  "contact state": "Kontaktzustand", "stack voltage": "Spannung am Stapel", "stack extension": "Dehnung des Stapels", "capacitor voltage": "Spannung am Kondensator", "shunt current": "Strom im Shunt",
  "contact surplus": "Kontaktüberschuss", "absorber displacement": "Weg des Tilgers", "absorber velocity": "Geschwindigkeit des Tilgers", "angular speed": "Winkelgeschwindigkeit",
  "normal force inner left": "Normalkraft innen links", "normal force inner right": "Normalkraft innen rechts", "normal force outer left": "Normalkraft außen links", "normal force outer right": "Normalkraft außen rechts",
  microphone: "Mikrofon", place: "Ort", angle: "Winkel", height: "Höhe", "height velocity": "Hubgeschwindigkeit", deflection: "Auslenkung", "deflection velocity": "Auslenkungsgeschwindigkeit",
  "body 1 displacement": "Weg von Körper 1", "body 3 height": "Höhe von Körper 3", "strain gauge": "Dehnmessstreifen", "angular velocity": "Winkelgeschwindigkeit", "arm displacement": "Weg des Arms", "arm laser": "Laser am Arm",
  "lever angle": "Winkel des Hebels", "lever velocity": "Geschwindigkeit des Hebels", "lever displacement": "Weg des Hebels", "lever laser": "Laser am Hebel", "cell force": "Zellenkraft", "load cell": "Kraftmesszelle",
  tilt: "Kippwinkel", "tilt velocity": "Kippgeschwindigkeit", "pin displacement": "Weg des Stifts", "pin velocity": "Geschwindigkeit des Stifts", "disc displacement": "Weg der Scheibe", "plate acceleration": "Beschleunigung der Platte",
  "slider acceleration": "Beschleunigung des Gleiters", "contact fraction": "Kontaktanteil", "pressure centre": "Druckmittelpunkt", "pressure centre x": "Druckmittelpunkt x", "pressure centre y": "Druckmittelpunkt y",
  "displacement of slider and plate": "Wege von Gleiter und Platte", "plate displacement": "Weg der Platte", "slider displacement": "Weg des Gleiters", "velocity of slider and plate": "Geschwindigkeiten von Gleiter und Platte",
  "plate velocity": "Geschwindigkeit der Platte", "slider velocity": "Geschwindigkeit des Gleiters", "pitch and roll": "Nicken und Rollen", "pitch displacement": "Nickweg", "roll displacement": "Rollweg",
  "pitch and roll velocity": "Nick- und Rollgeschwindigkeit", "pitch velocity": "Nickgeschwindigkeit", "roll velocity": "Rollgeschwindigkeit", "pitch and roll acceleration": "Nick- und Rollbeschleunigung",
  "pitch acceleration": "Nickbeschleunigung", "roll acceleration": "Rollbeschleunigung", position: "Position", openings: "Öffnungen", "noise force": "Rauschkraft", force: "Kraft", "pad velocity": "Geschwindigkeit des Belags",
  "disc velocity": "Geschwindigkeit der Scheibe", "pad displacement": "Weg des Belags", "pad acceleration": "Beschleunigung des Belags", "disc acceleration": "Beschleunigung der Scheibe", "drive speed": "Antriebsgeschwindigkeit",
  "normal force pad": "Normalkraft am Belag", "normal force of points": "Normalkräfte der Punkte", "normal force of pad": "Normalkraft des Belags", "slip speed of points": "Gleitgeschwindigkeiten der Punkte",
  "slip speed of pad": "Gleitgeschwindigkeit des Belags", "clamp force": "Klemmkraft", "slip distance": "Gleitweg", transducer: "Aufnehmer",
};
