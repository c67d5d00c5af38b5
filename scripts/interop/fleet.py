"""Runs ten sessions at virtual bedsides, and a Prometheus that scrapes them by the files in the folder
of scripts/interop/fleet.sh. Two sessions have TLS; an eleventh is scraped by an agent that writes to
the server. Checked are: `up`, counters that only grow, the number of series, promtool on the text
of a session, every query of the dashboard and of the alerts, wrong tokens and their alert, a session
that ends.

Every wait ends after TRIES looks. All processes that were started are ended, whatever happens.
"""

import hashlib
import json
import re
import secrets
import signal
import socket
import ssl
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from http.client import HTTPConnection
from pathlib import Path

COUNT = 10
# Bedsides with TLS, by the names of their certificates.
SECURED = {1: "one", 2: "two"}
MOST_SERIES = 300
TRIES, PAUSE_S = 400, 0.25
# Small and slow, so that two processors carry all of them.
BEDSIDE = """format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "64x48"
rate_hz = 5
[volume]
spacing_mm = 2.0
[picture]
image_size = "64x64"
[record]
full_frame = true
keep_free_mb = 0
[virtual]
scene = "ramp"
frames = 20
"""
# Queries of the dashboard without an answer: nothing of the kind happens here.
QUIET = {"ALERTS", "sonoweave_calibration_age_seconds"}

running = []


def fail(text):
    raise SystemExit(f"fleet: {text}")


def start(log, *words):
    process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log.open("wb"), stderr=subprocess.STDOUT)
    running.append(process)
    return process


def stop():
    for process in running:
        process.terminate()
    for process in running:
        try:
            process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def until(what, look):
    """Looks again until there is an answer, and returns it."""
    for _ in range(TRIES):
        if found := look():
            return found
        for process in running:
            if process.poll():
                fail(f"{' '.join(process.args[:2])} has ended with {process.returncode} before {what}")
        time.sleep(PAUSE_S)
    fail(f"{what}: not within {TRIES} looks")


def fetch(url, token=None, source="127.0.0.1"):
    """Returns code and text of an answer. Nothing is said about certificates: Prometheus checks them."""
    unchecked = ssl.create_default_context()
    unchecked.check_hostname, unchecked.verify_mode = False, ssl.CERT_NONE

    class From(HTTPConnection):
        def __init__(self, *words, **named):
            super().__init__(*words, **{**named, "source_address": (source, 0)})

    class Handler(urllib.request.HTTPHandler):
        def http_open(self, request):
            return self.do_open(From, request)

    request = urllib.request.Request(url, headers={"Authorization": f"Bearer {token}"} if token else {})
    handlers = [urllib.request.ProxyHandler({}), Handler(), urllib.request.HTTPSHandler(context=unchecked)]
    try:
        with urllib.request.build_opener(*handlers).open(request, timeout=30) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


class Bedside:
    """A session at a virtual bedside, with a folder of its own."""

    def __init__(self, program, place, number):
        self.number, self.folder = number, place / f"bedside-{number}"
        self.folder.mkdir()
        lines = '[status]\nlisten = "127.0.0.1:0"\n'
        self.token = None
        if number <= COUNT:
            # The server has the metrics' token only.
            self.token = secrets.token_hex(32)
            for key, token in [("token_file", secrets.token_hex(32)), ("metrics_token_file", self.token)]:
                path = self.folder / key
                path.touch(0o600)
                path.write_text(token)
                lines += f'{key} = "{path}"\n'
        self.is_secured = number in SECURED
        if self.is_secured:
            name = place / SECURED[number]
            lines += f'certificate = "{name}.crt"\nkey = "{name}.key"\n'
        (self.folder / "bedside.toml").write_text(BEDSIDE + lines)
        words = ["live", "--config", self.folder / "bedside.toml", "--headless", "--record", self.folder, "--duration", "900"]
        self.log = self.folder / "log"
        self.process = start(self.log, program, *words)

    def address(self):
        found = re.search(r"console: https?://([0-9.:]+)/", self.log.read_text())
        return found and found[1]

    def url(self, path):
        return f"{'https' if self.is_secured else 'http'}://{self.address()}{path}"

    def metrics(self):
        code, text = fetch(self.url("/metrics"), self.token)
        assert code == 200, (self.number, code, text)
        return text


class Prometheus:
    """A server, with the shipped configuration but for addresses and the scrape's interval."""

    def __init__(self, place, bedsides, behind_nat):
        self.files = place / "files"
        for target in (self.files / "targets").iterdir():
            target.unlink()
        text = (self.files / "prometheus.yml").read_text()
        head, job = text.split("  - job_name:")
        jobs = []
        for bedside in bedsides:
            number = bedside.number
            (self.files / f"{number}.token").write_text(bedside.token)
            # Two targets files have the same form as the shipped ones.
            labels = {"site": "north" if number % 2 else "south", "room": f"1.{number}", "bedside": str(number)}
            target = [{"targets": [bedside.address()], "labels": labels}]
            (self.files / "targets" / f"{number}.json").write_text(json.dumps(target))
            own = job.replace(" sonoweave\n", f" sonoweave-{number}\n").replace("sonoweave.token", f"{number}.token")
            own = own.replace("targets/*.json", f"targets/{number}.json")
            jobs.append(own if bedside.is_secured else own.replace("scheme: https", "scheme: http"))
        text = (head + "".join("  - job_name:" + own for own in jobs)).replace(": 15s", ": 1s")
        (self.files / "prometheus.yml").write_text(text)
        self.check("config", "prometheus.yml")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = "127.0.0.1:%d" % free.getsockname()[1]
        words = [f"--config.file={self.files}/prometheus.yml", f"--storage.tsdb.path={place}/data"]
        words += [f"--web.listen-address={self.address}", "--web.enable-remote-write-receiver"]
        start(place / "prometheus.log", "prometheus", *words)
        until("Prometheus is ready", lambda: self.is_ready())
        self.begin_agent(place, behind_nat)

    def begin_agent(self, place, bedside):
        text = (self.files / "agent.yml").read_text()
        text = re.sub(r"\n    basic_auth:.*", "\n", text, flags=re.DOTALL).replace(": 15s", ": 1s")
        text = text.replace("https://prometheus.example:9090", f"http://{self.address}")
        text = text.replace("127.0.0.1:9110", bedside.address())
        (self.files / "agent.yml").write_text(text)
        self.check("config", "--agent", "agent.yml")
        words = ["--enable-feature=agent", f"--config.file={self.files}/agent.yml"]
        words += [f"--storage.agent.path={place}/agent-data", "--web.listen-address=127.0.0.1:0"]
        start(place / "agent.log", "prometheus", *words)

    def check(self, *words):
        subprocess.run(["promtool", "check", *words], cwd=self.files, check=True, stdout=subprocess.DEVNULL)

    def is_ready(self):
        try:
            return fetch(f"http://{self.address}/-/ready")[0] == 200
        except urllib.error.URLError:
            return False

    def query(self, text):
        """Returns the samples of an instant query: labels and value."""
        url = f"http://{self.address}/api/v1/query?" + urllib.parse.urlencode({"query": text})
        code, answer = fetch(url)
        answer = json.loads(answer)
        if answer["status"] != "success":
            fail(f"{text}: {answer['error']}")
        return [(sample["metric"], float(sample["value"][1])) for sample in answer["data"]["result"]]

    def numbers(self, text, label="bedside"):
        return {metric.get(label, ""): value for metric, value in self.query(text)}


def check_text(bedside):
    """promtool finds no fault in the text of a session."""
    found = subprocess.run(["promtool", "check", "metrics"], input=bedside.metrics(), text=True, capture_output=True)
    if found.returncode or found.stdout or found.stderr:
        fail(f"promtool check metrics: {found.stdout}{found.stderr}")
    print("promtool check metrics: nothing to complain about")


def check_scrapes(server, names, text):
    until("up = 1 for all", lambda: server.numbers("up") == dict.fromkeys(names, 1.0))
    print(f"up: {len(names)} bedsides")
    often = "min(min by (bedside) (count_over_time(sonoweave_uptime_seconds[5m]))) >= 5"
    until("five scrapes of all", lambda: server.query(often))
    counters = set(re.findall(r"^([a-z_]+_total)[ {]", text, re.MULTILINE))
    missing = [name for name in counters if len(server.numbers(f"count by (bedside) ({name})")) < len(names)]
    fallen = [name for name in counters if server.query(f"resets({name}[5m]) > 0")]
    if not counters or missing or fallen:
        fail(f"counters that are missing: {missing}, that have fallen: {fallen}")
    grown = "count(increase(sonoweave_frames_arrived_total[5m]) > 0)"
    until("frames of all", lambda: server.query(f"{grown} == {len(names)}"))
    print(f"counters: {len(counters)}, none has fallen")
    series = server.numbers('count by (bedside) ({job=~"sonoweave.*", __name__=~"(sonoweave|process)_.*"})')
    scraped = server.numbers("scrape_samples_scraped")
    if series.keys() != set(names) or max([*series.values(), *scraped.values()]) > MOST_SERIES:
        fail(f"series by bedside: {series}, samples: {scraped}")
    print(f"series: at most {max(series.values()):.0f} a bedside")


def check_hashes(server, bedsides):
    """The labels of a session are the hashes of its files, as sha256sum has them."""
    sessions = {metric["bedside"]: metric for metric, _ in server.query("sonoweave_session_info")}
    for bedside in bedsides:
        [recording] = bedside.folder.glob("SESSION-*.mcap")
        parts = {"session": recording.name.encode(), "configuration": (bedside.folder / "bedside.toml").read_bytes()}
        for label, content in parts.items():
            expected, found = hashlib.sha256(content).hexdigest()[:12], sessions[str(bedside.number)][label]
            if found != expected:
                fail(f"bedside {bedside.number} has the {label} {found} instead of {expected}")
    print("hashes: those of recordings and configurations")


def check_queries(server, place):
    """Every query of the dashboard and of the alerts is understood; those of the dashboard have an answer."""
    dashboard = json.loads((place / "files/dashboard.json").read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", [])]
    for variable in dashboard["templating"]["list"]:
        if variable["type"] == "query":
            metric, label = re.fullmatch(r"label_values\((.*), (\w+)\)", variable["query"]["query"]).groups()
            queries.append(f"count by ({label}) ({metric})")
    for query in queries:
        filled = query.replace("$site", ".*").replace("$bedside", ".*").replace("$__rate_interval", "1m")
        found = server.query(filled)
        if not found and not any(name in query for name in QUIET):
            fail(f"the dashboard's query has no answer: {query}")
    url = f"http://{server.address}/api/v1/rules"
    rules = until(
        "all rules are evaluated",
        lambda: (rules := json.loads(fetch(url)[1])["data"]["groups"][0]["rules"])
        and all(rule["health"] == "ok" for rule in rules)
        and rules,
    )
    print(f"queries: {len(queries)} of the dashboard, {len(rules)} of alerts")


def alert(server, name, state, bedside):
    return server.query(f'ALERTS{{alertname="{name}", alertstate="{state}", bedside="{bedside.number}"}}')


def check_wrong_tokens(server, bedside):
    count = f'sonoweave_console_wrong_tokens_total{{bedside="{bedside.number}"}}'
    if server.query(count)[0][1] != 0:
        fail("a wrong token was counted before one was sent")
    # Another address than the server's sends them: the server's own token must go on to be read.
    for sent in range(1, 6):
        code, _ = fetch(bedside.url("/metrics"), secrets.token_hex(32), source="127.0.0.2")
        if code != 401:
            fail(f"a wrong token was answered with {code}")
        until(f"{sent} wrong tokens", lambda: server.query(f"{count} == {sent}"))
    until("the alert of wrong tokens", lambda: alert(server, "SonoweaveWrongTokens", "firing", bedside))
    others = server.query(f'sonoweave_console_wrong_tokens_total{{bedside!="{bedside.number}"}} > 0')
    if others:
        fail(f"others have counted wrong tokens: {others}")
    print("wrong tokens: counted, and the alert is raised")


def check_end(server, bedside, names):
    bedside.process.terminate()
    if bedside.process.wait(timeout=120) != 0:
        fail(f"bedside {bedside.number} did not end well; see {bedside.log}")
    expected = {**dict.fromkeys(names, 1.0), str(bedside.number): 0.0}
    until("up = 0 for the ended session", lambda: server.numbers("up") == expected)
    until("its alert", lambda: alert(server, "SonoweaveBedsideDown", "pending", bedside))
    print("a session that has ended: up is 0, and the alert is pending")


def main():
    program, place = sys.argv[1], Path(sys.argv[2])
    all_bedsides = [Bedside(program, place, number) for number in range(1, COUNT + 2)]
    until("all sessions listen", lambda: all(bedside.address() for bedside in all_bedsides))
    *bedsides, behind_nat = all_bedsides
    server = Prometheus(place, bedsides, behind_nat)
    # The agent's labels are those of its file.
    names = [str(bedside.number) for bedside in bedsides] + ["21"]
    check_scrapes(server, names, bedsides[0].metrics())
    check_hashes(server, bedsides)
    check_text(bedsides[0])
    check_queries(server, place)
    check_wrong_tokens(server, bedsides[4])
    check_end(server, bedsides[-1], names)


signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
try:
    main()
finally:
    stop()
print("fleet: all well")
