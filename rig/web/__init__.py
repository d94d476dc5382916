"""The bench in a browser: one page on loopback that starts runs, shows them live and changes values.

    guard, gate     which requests are accepted: host, origin and token of every request
    catalogue       scenes to choose from; form: values with unit, range and origin; picture: what moves
    run_control     starts and ends runs under the supervisor of `rig run`, one at a time
    live_runs       the runs of other terminals, which can be followed
    follower        a thread that follows a run over the bus; description, live_values and frames convert its messages
    broadcast       the newest frames for every connected page; a slow page loses frames and delays no other page
    recordings      the list of recordings; studies: maps and cost tables; jobs, job_process: their work
    sound           samples of a sensor for the loudspeakers of the pages
    app, server     routes, and the process: address, browser, Ctrl-C
    bridge          the bus of a run over WebSocket, a server of its own; bridge_client: one of its clients
    page/           the page: ES modules without a build step, one module for each pane

The server is a process beside plant, controllers and recorder. It follows the run as one viewer, however many pages are
connected, so the plant does the same work for one page as for ten.
"""
