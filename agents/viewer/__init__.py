"""The browser viewer: models that know no browser, what draws them, and rooms that bind both.

Modules:
    server: one browser, one state of its own.
    guard: who may talk to the viewer.
    serving: servers of viser that print nothing and answer only whom a guard admits.
    rooms: what a browser sees and does.
    record: pages that play without a server.
    explorer: a mechanism and what a person sets of it.
    drive: a controller in an episode, and all that is seen of it.
    controllers: those that can drive in an environment.
    play: a person and others in the same episode.
    steering: what keys mean to a person who steers.
    episodes: episodes to look at; best, median and worst.
    recorded: files of episodes.
    designs: designs of a search.
    stage: a step of an episode in the scene.
    body: a mechanism in the scene.
    solids: its shapes and lines.
    chart: a scatter plot in the scene.
    scoreboard: errors in the panel.
    html: tables and text in the panel.
    camera: where a browser looks from.
    clock: time that passes in a room.
"""
