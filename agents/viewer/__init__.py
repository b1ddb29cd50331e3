"""The browser viewer: models without a browser, drawing, and rooms that bind both.

Modules:
    server: separate rooms for every browser.
    guard: the requests that the viewer answers.
    serving: silent servers of viser that answer only requests that a guard admits.
    rooms: the tabs of a browser.
    record: pages that play without a server.
    around: walls around a mechanism, which a person moves.
    explorer: a mechanism under inputs that a person sets.
    drive: a controller in an episode, and a film of the episode.
    controllers: the controllers that can drive in an environment.
    play: a person and others in the same episode.
    steering: the keys by which a person steers.
    episodes: episodes to look at; best, median and worst.
    recorded: files of episodes.
    designs: designs of a search.
    stage: a step of an episode in the scene.
    body: a mechanism in the scene.
    solids: its shapes and lines.
    chart: a scatter plot in the scene.
    scoreboard: errors in the panel.
    choice: buttons of which one is chosen.
    html: tables and text in the panel.
    camera: where a browser looks from.
    clock: time that passes in a room.
"""
