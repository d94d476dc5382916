"""The bench in a browser: one page on loopback that starts runs, shows them live and changes values.

    catalogue       scenes to choose from; form their values with unit, range and origin; picture what moves
    run_control     starts and ends runs under the supervisor of `rig run`, one at a time; the runs of other terminals
    follower        a thread that follows a run over the bus; frames converts its messages
    playback        a whole recording, as a page that had watched the run would know it
    broadcast       the newest frames for every connected page; a slow page loses frames and delays no other page
    recordings      the recordings of a folder; studies maps, cost tables and branches; lessons their text and commands
    jobs            the work of all these, in processes (job_process)
    sound           samples of a sensor for the loudspeakers of the pages
    app, server     routes; the process: address, browser, which requests are accepted, Ctrl-C
    bridge          the bus of a run over WebSocket, a server of its own; bridge_client: one of its clients
    page/           the page: ES modules without a build step; german.json: texts; tracks.json: moving rigs

The server is a process beside plant, controllers and recorder. It follows the run as one viewer, however many pages are
connected, so the plant does the same work for one page as for ten.
"""
