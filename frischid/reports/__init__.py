"""The report: one HTML file that can be sent to a colleague and opens offline.

In come a model and its logs; `study.study` computes all that is shown, once, and `page.report` writes the file. The
chapters arrange numbers and compute none. Start reading at `page.report`. The folder has a plural name because
`frischid.report` is the function: a folder of that name would hide the function as soon as anything imports it.
"""
