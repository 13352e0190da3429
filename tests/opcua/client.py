"""A client of OPC UA that is not ours: asyncua. One JSON request a line on standard input, one JSON answer a line on standard output."""

import asyncio
import json
import logging
import sys
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography import x509

STANDARD = "http://opcfoundation.org/UA/MachineVision"
SYSTEM = "VisionSystem"


class Events:
    """Keeps what arrives."""

    def __init__(self):
        self.kept = []
        self.arrived = asyncio.Event()

    def event_notification(self, event):
        self.kept.append({name: plain(value) for name, value in event.get_event_props_as_fields_dict().items()})
        self.arrived.set()

    def datachange_notification(self, node, value, data):
        self.kept.append({"node": node.nodeid.to_string(), "value": plain(value)})
        self.arrived.set()

    def status_change_notification(self, status):
        self.kept.append({"status": str(status)})
        self.arrived.set()


def plain(value):
    """A value as JSON has it."""
    if isinstance(value, ua.Variant):
        return plain(value.Value)
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, ua.LocalizedText):
        return value.Text
    if isinstance(value, ua.NodeId):
        return value.to_string()
    if isinstance(value, ua.QualifiedName):
        return value.Name
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, bool) or isinstance(value, (int, float, str)) or value is None:
        return value
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    return str(value)


def argument(given):
    """An argument of a call: null, or a type of OPC UA with its value."""
    if given is None:
        return ua.Variant(None, ua.VariantType.Null)
    kind, value = given["type"], given["value"]
    if kind == "Variants":
        return ua.Variant([ua.Variant(one) for one in value], ua.VariantType.Variant, is_array=True)
    if hasattr(ua.VariantType, kind):
        return ua.Variant(value, getattr(ua.VariantType, kind))
    return ua.Variant(structure(kind, value), ua.VariantType.ExtensionObject)


def structure(kind, value):
    made = getattr(ua, kind)()
    for name, part in value.items():
        setattr(made, name, part)
    return made


class Session:
    """One connection."""

    def __init__(self):
        self.client = None
        self.events = Events()
        self.subscriptions = []

    async def connect(self, url, user=None, password=None, security=None, types=True):
        self.client = Client(url, timeout=60)
        if user is not None:
            self.client.set_user(user)
            self.client.set_password(password)
        if security is not None:
            await self.client.set_security_string(security)
        await self.client.connect()
        self.own = [n for n in range(2, 10) if await self.is_own(n)][0]
        self.standard = await self.client.get_namespace_index(STANDARD)
        if types:
            await self.load_types()
        return {"standard": self.standard, "own": self.own}

    async def certificate(self, folder):
        """A key with a certificate of its own, as a client makes it at its first start."""
        key, certificate = Path(folder) / "client.pem", Path(folder) / "client.der"
        uri = "urn:example.org:FreeOpcUa:opcua-asyncio"
        uses = [x509.oid.ExtendedKeyUsageOID.CLIENT_AUTH]
        await setup_self_signed_certificate(key, certificate, uri, "localhost", uses, {"commonName": "client"})
        return [str(certificate), str(key)]

    async def load_types(self):
        """asyncua takes types of the same name for one type, and the base model of today has TrimmedString too."""
        trimmed = ua.NodeId(3017, self.standard)
        if not hasattr(ua, "TrimmedString"):
            ua.TrimmedString = type("TrimmedString", (ua.String,), {})
        ua.register_basetype("TrimmedString", trimmed, ua.TrimmedString)
        await self.client.load_data_type_definitions()

    async def is_own(self, index):
        array = await self.client.get_namespace_array()
        return index < len(array) and array[index].endswith(":nodes")

    def node(self, path):
        if path == "Server":
            return self.client.nodes.server
        if path.startswith(("i=", "ns=")):
            return self.client.get_node(path)
        below = f"{SYSTEM}/{path}" if path else SYSTEM
        return self.client.get_node(ua.NodeId(below, self.own))

    async def disconnect(self):
        await self.client.disconnect()
        return True

    async def nodes(self, ids):
        """Class, name, data type, rank and type definition of each node of the standard."""
        found = {}
        for number in ids:
            node = self.client.get_node(ua.NodeId(number, self.standard))
            kinds = [ua.AttributeIds.NodeClass, ua.AttributeIds.BrowseName, ua.AttributeIds.DataType, ua.AttributeIds.ValueRank]
            values = await node.read_attributes(kinds)
            good = [v.Value.Value if v.StatusCode.is_good() and v.Value else None for v in values]
            types = await node.get_references(ua.ObjectIds.HasTypeDefinition, ua.BrowseDirection.Forward)
            found[number] = {
                "class": ua.NodeClass(good[0]).name if good[0] is not None else None,
                "name": good[1].Name if good[1] else None,
                "namespace": good[1].NamespaceIndex if good[1] else None,
                "data_type": good[2].to_string() if good[2] else None,
                "rank": good[3],
                "type": types[0].NodeId.to_string() if types else None,
            }
        return found

    async def browse(self):
        """Paths of all nodes of the cell, with their types, from the folder of objects on."""
        found = {}

        async def visit(node, path):
            for child in await node.get_children():
                name = await child.read_browse_name()
                below = f"{path}/{name.Name}"
                if below in found:
                    continue
                kind = await child.read_type_definition() if await child.read_node_class() != ua.NodeClass.Method else None
                found[below] = kind.to_string() if kind else "method"
                await visit(child, below)

        for child in await self.client.nodes.objects.get_children():
            name = await child.read_browse_name()
            if name.NamespaceIndex == self.own:
                found[name.Name] = (await child.read_type_definition()).to_string()
                await visit(child, name.Name)
        return found

    async def read(self, path):
        value = await self.node(path).read_data_value(raise_on_bad_status=False)
        return {"status": value.StatusCode.name, "value": plain(value.Value)}

    async def write(self, path, value):
        await self.node(path).write_value(argument(value))
        return True

    async def call(self, object, method, args=()):
        request = ua.CallMethodRequest()
        request.ObjectId = self.node(object).nodeid
        below = f"{object}/{method}" if not method.startswith(("i=", "ns=")) else method
        request.MethodId = self.node(below).nodeid
        request.InputArguments = [argument(one) for one in args]
        result = (await self.client.uaclient.call([request]))[0]
        return {
            "status": result.StatusCode.name,
            "arguments": [status.name for status in result.InputArgumentResults or []],
            "outputs": [plain(one) for one in result.OutputArguments or []],
        }

    async def subscribe(self, node="Server", types=(1013, 1018, 1019, 1022, 1023, 1024), interval=100, queue=0):
        subscription = await self.client.create_subscription(interval, self.events)
        types = [self.client.get_node(ua.NodeId(number, self.standard)) for number in types]
        await subscription.subscribe_events(self.node(node), types, queuesize=queue)
        self.subscriptions.append(subscription)
        return True

    async def watch(self, paths, interval=100):
        subscription = await self.client.create_subscription(interval, self.events)
        await subscription.subscribe_data_change([self.node(path) for path in paths])
        self.subscriptions.append(subscription)
        return True

    async def take(self, count=0, seconds=60.0):
        """The events so far, at least so many of them unless the time is over."""
        end = asyncio.get_running_loop().time() + seconds
        while len(self.events.kept) < count:
            self.events.arrived.clear()
            left = end - asyncio.get_running_loop().time()
            if left <= 0:
                break
            try:
                await asyncio.wait_for(self.events.arrived.wait(), left)
            except asyncio.TimeoutError:
                break
        kept, self.events.kept = self.events.kept, []
        return kept

    async def forget(self):
        """Ends the connection as a broken cable does."""
        self.client.uaclient.protocol.transport.abort()
        return True


async def main():
    logging.disable(logging.CRITICAL)
    session = Session()
    loop = asyncio.get_running_loop()
    while True:
        line = await loop.run_in_executor(None, sys.stdin.readline)
        if not line:
            return
        request = json.loads(line)
        try:
            if request["do"] == "new":
                session = Session()
                answer = True
            else:
                answer = await getattr(session, request["do"])(**request.get("with", {}))
            answer = {"ok": answer}
        except Exception as error:  # every failure is an answer
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


asyncio.run(main())
